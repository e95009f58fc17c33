"""A subject as one of a family: the dimensions it is made from, and how others are made."""

from collections.abc import Iterator, Mapping
from typing import Any

from mechsim import units
from mechsim.analytic import catalog
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.analytic.derivatives.catalog_family import catalog_family
from mechsim.analytic.derivatives.dimensions import DesignFamily, Dimension
from mechsim.analytic.derivatives.joint_places import placed_family
from mechsim.analytic.forms import Form
from mechsim.model.forces import Forces
from mechsim.model.mechanism import Mechanism
from mechsim.subjects import gallery
from mechsim.subjects.parameter_units import parameter_units, reckoned_from
from mechsim.subjects.python_object import parameters_of
from mechsim.subjects.subject import described, is_file, load
from mechsim.subjects.toml_reader import values_of
from mechsim.subjects.toml_source import read_source


def family(
    model: str | Form | Mechanism, set: Mapping[str, str | float] | None = None, **asked: Any
) -> DesignFamily:
    """Return the family of a subject: its dimensions as they stand, in SI, and what makes others.

    Of a mechanism of the catalogue and of a TOML file these are the parameters, those of a place by parts,
    as pivot.x; of a function in a Python file its arguments that have numbers as defaults, in what unit the
    file does not say; of any other subject the places of joints, as JOINT.at.x (see `joint_places`).

    Args:
        model: as `load` takes it, or what moves itself.
        set: parameter -> its value, as `load` takes it.
        asked: what else `load` takes.

    Raises:
        InputError: as `load`.
    """
    if not isinstance(model, str):
        form = LoopForm(model) if isinstance(model, Mechanism) else model
        return catalog_family(form) if isinstance(form, ClosedForm) else placed_family(form)
    given = dict(set or {})
    form, path = load(model, given, **asked), toml_path(model)
    found = _arguments(model, given)
    if isinstance(form, ClosedForm) and not found:
        return catalog_family(form)
    found = found if path is None else {one.name: one for one in _parameters(path, given)}
    if not found:
        return placed_family(form)

    def changed(values: Mapping[str, float]) -> dict[str, str | float]:
        return given | {name: in_text(value, found[name].unit) for name, value in values.items()}

    def make(values: Mapping[str, float]) -> Form:
        return load(model, changed(values), **asked) if values else form

    def told(values: Mapping[str, float]) -> Form:
        return described(model, changed(values), **asked) if values else form

    def forces(values: Mapping[str, float]) -> Forces | None:
        made = told(values)
        return made.forces

    acted = forces if getattr(form, "forces", None) is not None else None
    read = {} if path is None else reckoned_from(read_source(path).document)
    reckoned = {name: of for name, of in read.items() if of and name not in given}
    free = tuple(name for name in found if name not in reckoned)
    return DesignFamily(form.name, found, lambda values: told(values).mechanism, make, acted, free, reckoned)


def in_text(value: float, unit: str) -> str:
    """Return the value of a dimension in SI as text that a file of any units reads to the last bit."""
    return f"{float(value)!r} {unit}" if unit in ("m", "rad") else repr(float(value))


def toml_path(model: str) -> str | None:
    """Return the TOML file that a model is read from; None where it is none."""
    if is_file(model):
        return model if model.lower().endswith(".toml") else None
    place = gallery.files().get(model)
    return None if place is None or model in catalog.DRIVES else str(place)


def _arguments(model: str, given: Mapping[str, str | float]) -> dict[str, Dimension]:
    """Return the parameters of a function in a Python file, as they are given."""
    if ".py:" not in model:
        return {}
    known = parameters_of(model)
    values = known | {
        name: units.of_any_kind(one, name)[0] if isinstance(one, str) else one for name, one in given.items()
    }
    return {name: Dimension(name, float(value), "1") for name, value in values.items()}


def _parameters(path: str, changed: Mapping[str, str | float]) -> Iterator[Dimension]:
    """Yield the parameters of a file; one whose use does not tell what it measures as the file has it."""
    source = read_source(path)
    given, told = source.document.get("parameters", {}), parameter_units(source.document)
    values = values_of(source).with_parameters(given, changed, told)
    for name, value in values.parameters.items():
        unit = values.unit_of(name, given[name], told)
        if unit is None:
            yield Dimension(name, value, "1")
        else:
            yield Dimension(name, values.in_si(value, unit), unit, values.declared(given[name], unit))
