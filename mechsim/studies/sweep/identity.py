"""What tells one sweep from another: all that its numbers depend on, as one short text."""

import hashlib
import json
from pathlib import Path

from mechsim._version import __version__
from mechsim.analytic.derivatives.numbers import numbers_of
from mechsim.studies.sweep.subject import OfCatalog, OfPython, OfToml
from mechsim.studies.sweep.task import SweepTask


def identity(task: SweepTask) -> str:
    """Return the mark of a sweep: a hash of its subject, designs, measures and poses."""
    designs = task.designs
    said = {
        "version": __version__,
        "subject": _subject(task),
        "spread": designs.spread,
        "designs": {name: _hash(one.tobytes()) for name, one in designs.values.items()},
        "order": [*designs.values],
        "measures": [_measure(one.name, one.subject, one.kind) for one in task.measures],
        "samples": task.samples,
        "speed": repr(task.pace),
        "settings": repr(task.settings),
    }
    return _hash(json.dumps(said, sort_keys=True).encode())


def _subject(task: SweepTask) -> str:
    make, mechanism = task.subject.make, task.subject.form.mechanism
    if isinstance(make, OfCatalog):
        return repr(make.form)
    if isinstance(make, OfToml):
        return repr((make.source.document, sorted(make.given.items())))
    if isinstance(make, OfPython):
        return repr((sorted(make.given.items()), make.model.rpartition(":")[2], _file(make.model)))
    programs = getattr(task.subject.form, "programs", None)
    drivers = mechanism.drivers if programs is None else (*programs.drivers, repr(programs.duration))
    return repr((task.subject.name, drivers, _hash(numbers_of(mechanism).tobytes())))


def _measure(name: str, subject: str, kind: str) -> str:
    if kind != "function":
        return name
    return name + _file(subject)


def _file(where: str) -> str:
    """Return the hash of a Python file, given FILE.py:OBJECT."""
    return _hash(Path(where.rpartition(":")[0]).read_bytes())


def _hash(given: bytes) -> str:
    return hashlib.sha256(given).hexdigest()[:32]
