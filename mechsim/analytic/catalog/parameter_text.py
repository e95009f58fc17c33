"""Parameters of a catalogue mechanism given as text: `14mm`, `43,-10,-24mm`, `+1`, `on`."""

from typing import Any

from mechsim import units
from mechsim.errors import InputError


def parameter_value(mechanism: str, field: Any, parameter: str, given: Any) -> Any:
    """Return the value of a parameter: text is read with its unit, all else is returned as it is.

    Args:
        mechanism: its name.
        field: of the mechanism's class, which declares unit, options and default.
        parameter: its name.
        given: text, a sequence with text in it, or a value in SI.

    Raises:
        InputError: for text that is no such value.
    """
    unit, what = field.metadata["unit"], f"{parameter} of {mechanism}"
    if isinstance(given, tuple | list) and any(isinstance(part, str) for part in given):
        return tuple(units.si(part, unit, what) for part in given)
    if not isinstance(given, str):
        return given
    if "options" in field.metadata:
        return _option(what, field.metadata["options"], given)
    if isinstance(field.default, tuple):
        values = units.parse_vector(given, unit, what)
        if len(values) != len(field.default):
            raise InputError(
                f"{what} is {given!r}, {len(values)} numbers; give {len(field.default)}, with commas"
            )
        return values
    value = units.parse(given, unit, what)
    if isinstance(field.default, int):
        if value != int(value):
            raise InputError(f"{what} is {given!r}; give a whole number")
        return int(value)
    return value


def _option(what: str, options: tuple[Any, ...], given: str) -> Any:
    words = {str(option).lower(): option for option in options}
    if set(options) == {False, True}:
        words = {"on": True, "off": False, "true": True, "false": False, "1": True, "0": False}
    word = given.lower().removeprefix("+")
    if word not in words:
        raise InputError(f"{what} is {given!r}; it can be {' or '.join(list(words)[:2])}")
    return words[word]
