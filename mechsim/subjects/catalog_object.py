"""A mechanism of the catalogue with parameters given as text."""

from collections.abc import Mapping
from typing import Any

from mechsim import units
from mechsim.analytic import catalog
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.errors import InputError


def read_catalog(name: str, changed: Mapping[str, str]) -> ClosedForm:
    """Return a catalogue mechanism with some parameters changed.

    Args:
        name: of the mechanism.
        changed: parameter -> its value as text; bare numbers are in SI.

    Raises:
        InputError: for an unknown name or parameter (with the nearest known one) or a bad value.
    """
    fields = catalog.parameters(name)
    values: dict[str, Any] = {}
    for parameter, text in changed.items():
        if parameter not in fields:
            raise InputError(
                f"{name} has no parameter {parameter!r}{catalog.nearest(parameter, list(fields))}"
            )
        values[parameter] = _value(name, fields[parameter], parameter, text)
    return catalog.make(name, **values)


def _value(mechanism: str, field: Any, parameter: str, text: str) -> Any:
    unit, what = field.metadata["unit"], f"{parameter} of {mechanism}"
    options = field.metadata.get("options")
    if options is not None:
        words = {str(option).lower(): option for option in options}
        if set(options) == {False, True}:
            words = {"on": True, "off": False, "true": True, "false": False, "1": True, "0": False}
        word = text.lower().removeprefix("+")
        if word not in words:
            raise InputError(f"{what} is {text!r}; it can be {' or '.join(list(words)[:2])}")
        return words[word]
    if isinstance(field.default, tuple):
        values = units.parse_vector(text, unit, what)
        if len(values) != len(field.default):
            raise InputError(
                f"{what} is {text!r}, {len(values)} numbers; give {len(field.default)}, with commas"
            )
        return values
    value = units.parse(text, unit, what)
    if isinstance(field.default, int):
        if value != int(value):
            raise InputError(f"{what} is {text!r}; give a whole number")
        return int(value)
    return value
