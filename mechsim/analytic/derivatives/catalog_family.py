"""A mechanism of the catalogue as one of a family of others with other dimensions."""

from collections.abc import Mapping
from dataclasses import fields, replace
from typing import Any

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.derivatives.dimensions import DesignFamily, Dimension
from mechsim.model.mechanism import Mechanism

AXES = "xyz"


def catalog_family(form: ClosedForm) -> DesignFamily:
    """Return the family of a catalogue mechanism: all its dimensions, parts of places as NAME.x, NAME.y."""
    found: dict[str, Dimension] = {}
    for parameter in fields(form):
        unit, value = parameter.metadata["unit"], getattr(form, parameter.name)
        if "options" in parameter.metadata or isinstance(parameter.default, int):
            continue
        for name, one in _parts(parameter.name, value).items():
            found[name] = Dimension(name, float(one), unit)

    def describe(values: Mapping[str, float]) -> Mechanism:
        return _unchecked(form, _whole(form, values)).description

    return DesignFamily(form.name, found, describe, lambda values: replace(form, **_whole(form, values)))


def _parts(name: str, value: Any) -> dict[str, float]:
    if isinstance(value, tuple):
        return {f"{name}.{axis}": one for axis, one in zip(AXES, value, strict=False)}
    return {name: value}


def _whole(form: ClosedForm, values: Mapping[str, float]) -> dict[str, Any]:
    """Return parameters from dimensions: places put together from their parts."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        parameter, dot, axis = name.partition(".")
        if not dot:
            found[parameter] = value
            continue
        place = list(found.get(parameter, getattr(form, parameter)))
        place[AXES.index(axis)] = value
        found[parameter] = tuple(place)
    return found


def _unchecked(form: ClosedForm, values: Mapping[str, Any]) -> ClosedForm:
    """Return a mechanism whose dimensions nothing has checked, of which only the description is of use."""
    one = object.__new__(type(form))
    for parameter in fields(form):
        object.__setattr__(one, parameter.name, values.get(parameter.name, getattr(form, parameter.name)))
    return one
