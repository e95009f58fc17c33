"""The hash of a sweep: all inputs that its numbers depend on."""

import hashlib
import json
from pathlib import Path

from mechsim._version import __version__
from mechsim.analytic.derivatives.parameter_vector import numbers_of
from mechsim.studies.sweep.subject import OfCatalog, OfPython, OfToml
from mechsim.studies.sweep.task import SweepTask


def identity(task: SweepTask) -> str:
    """Return the hash of a sweep's subject, designs, measures and poses."""
    designs = task.designs
    description = {
        "version": __version__,
        "subject": _subject(task),
        "spread": designs.spread,
        "designs": {name: _hash(values.tobytes()) for name, values in designs.values.items()},
        "order": [*designs.values],
        "measures": [_measure(values.name, values.subject, values.kind) for values in task.measures],
        "samples": task.samples,
        "speed": repr(task.path_speed),
        "settings": repr(task.settings),
    }
    return _hash(json.dumps(description, sort_keys=True).encode())


def _subject(task: SweepTask) -> str:
    make, mechanism = task.subject.make, task.subject.solver.mechanism
    if isinstance(make, OfCatalog):
        return repr(make.solver)
    if isinstance(make, OfToml):
        return repr((make.source.document, sorted(make.fixed.items())))
    if isinstance(make, OfPython):
        return repr((sorted(make.fixed.items()), make.model.rpartition(":")[2], _file(make.model)))
    motion_laws = getattr(task.subject.solver, "motion_laws", None)
    drivers = mechanism.drivers if motion_laws is None else (*motion_laws.drivers, repr(motion_laws.duration))
    return repr((task.subject.name, drivers, _hash(numbers_of(mechanism).tobytes())))


def _measure(name: str, subject: str, kind: str) -> str:
    if kind != "function":
        return name
    return name + _file(subject)


def _file(address: str) -> str:
    """Return the hash of a Python file, given FILE.py:OBJECT."""
    return _hash(Path(address.rpartition(":")[0]).read_bytes())


def _hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:32]
