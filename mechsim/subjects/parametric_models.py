"""Parametric models: the dimensions of a mechanism, and how its variants are made."""

from collections.abc import Iterator, Mapping
from typing import Any

from mechsim import units
from mechsim.analytic import catalog
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.derivatives.dimensions import DesignFamily, Dimension, catalog_family, placed_family
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.model.forces import Forces
from mechsim.model.mechanism import Mechanism
from mechsim.subjects import gallery
from mechsim.subjects.parameter_units import parameter_dependencies, parameter_units
from mechsim.subjects.python_object import parameters_of
from mechsim.subjects.subject import is_file, load, load_unassembled
from mechsim.subjects.toml_reader import values_of
from mechsim.subjects.toml_source import read_source


def parametric_model(
    model: str | Form | Mechanism, set: Mapping[str, str | float] | None = None, **options: Any
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
    changes = dict(set or {})
    form, path = load(model, changes, **options), toml_path(model)
    dimensions = _python_parameters(model, changes)
    if isinstance(form, ClosedForm) and not dimensions:
        return catalog_family(form)
    dimensions = (
        dimensions
        if path is None
        else {dimension.name: dimension for dimension in _toml_parameters(path, changes)}
    )
    if not dimensions:
        return placed_family(form)

    def changed_values(values: Mapping[str, float]) -> dict[str, str | float]:
        return changes | {name: as_text(value, dimensions[name].unit) for name, value in values.items()}

    def make(values: Mapping[str, float]) -> Form:
        return load(model, changed_values(values), **options) if values else form

    def describe(values: Mapping[str, float]) -> Form:
        return load_unassembled(model, changed_values(values), **options) if values else form

    def forces(values: Mapping[str, float]) -> Forces | None:
        form_ = describe(values)
        return form_.forces

    forces_of = forces if getattr(form, "forces", None) is not None else None
    dependencies = {} if path is None else parameter_dependencies(read_source(path).document)
    derived = {name: sources for name, sources in dependencies.items() if sources and name not in changes}
    independent = tuple(name for name in dimensions if name not in derived)
    return DesignFamily(
        form.name,
        dimensions,
        lambda values: describe(values).mechanism,
        make,
        forces_of,
        independent,
        derived,
    )


def as_text(value: float, unit: str) -> str:
    """Return the value of a dimension in SI as text that a file of any units reads to the last bit."""
    return f"{float(value)!r} {unit}" if unit in ("m", "rad") else repr(float(value))


def toml_path(model: str) -> str | None:
    """Return the TOML file that a model is read from; None where it is none."""
    if is_file(model):
        return model if model.lower().endswith(".toml") else None
    path = gallery.files().get(model)
    return None if path is None or model in catalog.DRIVES else str(path)


def _python_parameters(model: str, changes: Mapping[str, str | float]) -> dict[str, Dimension]:
    """Return the parameters of a function in a Python file, as they are given."""
    if ".py:" not in model:
        return {}
    defaults = parameters_of(model)
    values = defaults | {
        name: units.of_any_kind(value_, name)[0] if isinstance(value_, str) else value_
        for name, value_ in changes.items()
    }
    return {name: Dimension(name, float(value), "1") for name, value in values.items()}


def _toml_parameters(path: str, changed: Mapping[str, str | float]) -> Iterator[Dimension]:
    """Yield the parameters of a file; one whose use does not tell what it measures as the file has it."""
    source = read_source(path)
    parameters, units_of = source.document.get("parameters", {}), parameter_units(source.document)
    values = values_of(source).with_parameters(parameters, changed, units_of)
    for name, value in values.parameters.items():
        unit = values.unit_of(name, parameters[name], units_of)
        if unit is None:
            yield Dimension(name, value, "1")
        else:
            yield Dimension(
                name, values.in_si(value, unit), unit, values.declared_unit(parameters[name], unit)
            )
