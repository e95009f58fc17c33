"""What is swept: a subject that can be sent to another process, and made there in other designs."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.catalog.many_designs import AXES
from mechsim.analytic.derivatives.dimensions import DesignFamily
from mechsim.analytic.forms import Form
from mechsim.model.mechanism import Mechanism
from mechsim.subjects.families import family, toml_path
from mechsim.subjects.toml_reader import toml_subject
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
        given: parameter -> text, of those that are set and do not vary.
    """

    source: TomlSource
    given: Mapping[str, str] = field(default_factory=dict[str, str])

    def __call__(self, values: Mapping[str, float]) -> Form:
        """Return a design."""
        changed = {name: repr(float(value)) for name, value in values.items()}
        return toml_subject(self.source, {**self.given, **changed}).form


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
    found = family(model, set, **asked)
    form = found.make({})
    name = model if isinstance(model, str) else form.name
    if isinstance(form, ClosedForm):
        return SweptSubject(name, form, found, OfCatalog(form))
    path = toml_path(model) if isinstance(model, str) else None
    if path is not None and form.programs is None and not any(asked.values()):
        given = {one: str(value) for one, value in (set or {}).items()}
        return SweptSubject(name, form, found, OfToml(read_source(path), given))
    return SweptSubject(name, form, found, found.make)
