"""Declaring the parameters of a catalogue mechanism, and checking what is given for them."""

from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.errors import InputError
from mechsim.numerics.arrays import Array

# squares and fourth powers of lengths and rates below this stay far from overflow
HUGE = 1e30


def length(default: float, doc: str) -> Any:
    """Declare a length in [m] that must be positive and finite."""
    return field(default=default, metadata={"unit": "m", "doc": doc, "positive": True})


def offset(default: float, doc: str) -> Any:
    """Declare a length in [m] of either sign."""
    return field(default=default, metadata={"unit": "m", "doc": doc})


def angle(default: float, doc: str) -> Any:
    """Declare an angle in [rad]."""
    return field(default=default, metadata={"unit": "rad", "doc": doc})


def number(default: float, doc: str) -> Any:
    """Declare a pure number."""
    return field(default=default, metadata={"unit": "1", "doc": doc})


def position(default: tuple[float, ...], doc: str) -> Any:
    """Declare a point in [m]."""
    return field(default=default, metadata={"unit": "m", "doc": doc})


def choice(default: Any, options: tuple[Any, ...], doc: str) -> Any:
    """Declare a parameter that takes one of a few values."""
    return field(default=default, metadata={"unit": "1", "doc": doc, "options": options})


def checked(mechanism: str, name: str, value: Any, default: Any, rule: Mapping[str, Any]) -> Any:
    """Return a parameter as it is to be kept; raise InputError for what its declaration does not allow."""
    if "options" in rule:
        if np.ndim(value) != 0 or value not in rule["options"]:
            options = " or ".join(str(option) for option in rule["options"])
            raise InputError(f"{mechanism}: {name} is {value!r}; it can be {options}")
        return value
    try:
        numbers = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.array(np.nan)
    shape, most = np.shape(default), HUGE if rule["unit"] == "m" else np.inf
    if numbers.shape != shape or not (np.abs(numbers) < most).all():
        count = f"{shape[0]} finite numbers" if shape else "a finite number"
        raise InputError(f"{mechanism}: {name} is {value} {rule['unit']}; give {count}{_below(most)}")
    if rule.get("positive") and not float(numbers) > 1.0 / HUGE:
        raise InputError(
            f"{mechanism}: {name} is {value} {rule['unit']}; give a length above 0, {1.0 / HUGE:g} m at least"
        )
    if shape:
        return tuple(numbers.tolist())
    return value.item() if isinstance(value, np.generic) else value


def checked_rate(mechanism: str, what: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    """Return a crank rate for each crank angle; raise InputError for what is none."""
    value = units.si(value, "rad/s", f"the crank's {what}") if what == "speed" else value
    try:
        rate = np.broadcast_to(np.asarray(value, dtype=np.float64), shape)
    except (TypeError, ValueError):
        rate = np.full(shape, np.nan)
    if not (np.abs(rate) < HUGE).all():
        raise InputError(
            f"{mechanism}: the crank's {what} must be one finite number{_below(HUGE)}, or one for each of "
            f"the {shape[0]} crank angles; give it in SI units"
        )
    return rate


def _below(most: float) -> str:
    return f" below {most:g}" if most < np.inf else ""


def parameter_value(mechanism: str, field: Any, parameter: str, value: Any) -> Any:
    """Return the value of a parameter: text is read with its unit, all else is returned as it is.

    Args:
        mechanism: its name.
        field: of the mechanism's class, which declares unit, options and default.
        parameter: its name.
        value: text, a sequence with text in it, or a value in SI.

    Raises:
        InputError: for text that is no such value.
    """
    unit, what = field.metadata["unit"], f"{parameter} of {mechanism}"
    if isinstance(value, tuple | list) and any(isinstance(component, str) for component in value):
        return tuple(units.si(component, unit, what) for component in value)
    if not isinstance(value, str):
        return value
    if "options" in field.metadata:
        return _option(what, field.metadata["options"], value)
    if isinstance(field.default, tuple):
        values = units.parse_vector(value, unit, what)
        if len(values) != len(field.default):
            raise InputError(
                f"{what} is {value!r}, {len(values)} numbers; give {len(field.default)}, with commas"
            )
        return values
    number = units.parse(value, unit, what)
    if isinstance(field.default, int):
        if number != int(number):
            raise InputError(f"{what} is {value!r}; give a whole number")
        return int(number)
    return number


def _option(what: str, options: tuple[Any, ...], text: str) -> Any:
    words = {str(option).lower(): option for option in options}
    if set(options) == {False, True}:
        words = {"on": True, "off": False, "true": True, "false": False, "1": True, "0": False}
    word = text.lower().removeprefix("+")
    if word not in words:
        raise InputError(f"{what} is {text!r}; it can be {' or '.join(list(words)[:2])}")
    return words[word]
