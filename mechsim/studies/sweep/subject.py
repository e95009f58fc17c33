"""What is swept: a subject that can be sent to another process, and made there in other designs."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.catalog.many_designs import AXES
from mechsim.analytic.derivatives.dimensions import DesignFamily
from mechsim.analytic.forms import Form
from mechsim.model.links import Pose
from mechsim.model.mechanism import Mechanism
from mechsim.subjects.parametric_models import as_text, parametric_model, toml_path
from mechsim.subjects.python_object import parameters_of, python_factory
from mechsim.subjects.toml_reader import toml_model
from mechsim.subjects.toml_source import TomlSource, read_source

Make = Callable[[Mapping[str, float]], Form]


@dataclass(frozen=True)
class OfCatalog:
    """Makes designs of a catalogue mechanism."""

    form: ClosedForm

    def __call__(self, values: Mapping[str, float]) -> Form:
        """Return a design, checked."""
        changed: dict[str, Any] = {}
        for name, value in values.items():
            parameter, dot, axis = name.partition(".")
            given = changed.get(parameter, getattr(self.form, parameter))
            if dot:
                given = list(given)
                given[AXES.index(axis)] = value
                changed[parameter] = tuple(given)
            else:
                whole = isinstance(given, int) and float(value).is_integer()
                changed[parameter] = type(given)(value) if whole else value
        return replace(self.form, **changed)


@dataclass(frozen=True)
class OfToml:
    """Makes designs of a TOML file, which was read before.

    Attributes:
        source: the file.
        given: parameter -> text or number in SI, of those that are set and do not vary.
        guess: link -> pose of the file as it stands, closed; it selects the assembly of designs where the
            file itself has no guess of a link.
        units: parameter -> SI unit.
    """

    source: TomlSource
    given: Mapping[str, str | float] = field(default_factory=dict[str, "str | float"])
    guess: Mapping[str, Pose] = field(default_factory=dict[str, Pose])
    units: Mapping[str, str] = field(default_factory=dict[str, str])

    def __call__(self, values: Mapping[str, float]) -> Form:
        """Return a design."""
        changed = {name: as_text(value, self.units.get(name, "1")) for name, value in values.items()}
        form = toml_model(self.source, {**self.given, **changed}).form
        mechanism = form.mechanism
        if len(mechanism.guess) == len(mechanism.links):
            return form
        return replace(form, mechanism=replace(mechanism, guess={**self.guess, **mechanism.guess}))


@dataclass(frozen=True)
class OfPython:
    """Makes designs by a function in a Python file, which each process that makes some runs.

    Attributes:
        model: FILE.py:FUNCTION.
        given: argument -> text, of those that are set and do not vary.
    """

    model: str
    given: Mapping[str, str | float] = field(default_factory=dict[str, "str | float"])

    def __call__(self, values: Mapping[str, float]) -> Form:
        """Return a design."""
        changed = os.stat(self.model.rpartition(":")[0]).st_mtime_ns
        return _maker(self.model, changed)({**self.given, **values})


@lru_cache(maxsize=8)
def _maker(model: str, changed: int) -> Callable[[Mapping[str, str | float]], Form]:
    """Return what makes designs by a Python file that was last changed then; the file is run once."""
    return python_factory(model)


@dataclass(frozen=True)
class SweptSubject:
    """A subject, and what makes its designs.

    Attributes:
        name: as it was given.
        form: as it stands.
        family: its parameters.
        make: parameter -> value in SI, of those that vary, makes a design; it can be sent to other processes.
    """

    name: str
    form: Form
    family: DesignFamily
    make: Make

    @property
    def closed(self) -> ClosedForm | None:
        """The closed form whose own parameters vary; None for any other subject."""
        return self.form if isinstance(self.form, ClosedForm) and isinstance(self.make, OfCatalog) else None


def swept(
    model: str | Form | Mechanism, set: Mapping[str, str | float] | None = None, **asked: Any
) -> SweptSubject:
    """Return a subject to be swept.

    Args:
        model: as `load` takes it, or what moves itself.
        set: parameter -> its value, as `load` takes it.
        asked: what else `load` takes.

    Raises:
        InputError: as `load`.
    """
    found = parametric_model(model, set, **asked)
    form = found.make({})
    name = model if isinstance(model, str) else form.name
    given = dict(set or {})
    if isinstance(model, str) and ".py:" in model and not any(asked.values()) and parameters_of(model):
        return SweptSubject(name, form, found, OfPython(model, given))
    if isinstance(form, ClosedForm):
        return SweptSubject(name, form, found, OfCatalog(form))
    path = toml_path(model) if isinstance(model, str) else None
    of = {one.name: one.unit for one in found.dimensions.values()}
    if path is not None and form.programs is None and not any(asked.values()):
        make = OfToml(read_source(path), given, form.mechanism.guess, of)
        return SweptSubject(name, form, found, make)
    return SweptSubject(name, form, found, found.make)
