"""Parameters of mechanisms with formulas: values, units, limits, and how text is read."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from mechsim import units
from mechsim.errors import InputError, several
from mechsim.mechanism.links import AXES
from mechsim.numerics.arrays import HUGE, numbers
from mechsim.units import Unit


@dataclass(frozen=True, slots=True)
class FormulaParameter:
    """A parameter of a mechanism with formulas.

    Attributes:
        name: its name.
        default: its default in SI; a tuple is a position.
        unit: "m", "rad" or "1".
        doc: its meaning.
        options: the values that it can have; empty for any number.
        positive: whether it must be above 0, as a length.
    """

    name: str
    default: Any
    unit: Unit
    doc: str
    options: tuple[Any, ...] = ()
    positive: bool = False

    @property
    def is_choice(self) -> bool:
        """Whether it is a whole number or a choice, such as an assembly mode."""
        return bool(self.options) or isinstance(self.default, int)

    def checked(self, mechanism: str, value: Any) -> Any:
        """Return a value as it is stored.

        Raises:
            InputError: for a value that is not allowed.
        """
        if self.options:
            if np.ndim(value) != 0 or value not in self.options:
                options = " or ".join(str(option) for option in self.options)
                raise InputError(f"{mechanism}: {self.name} is {value!r}; it can be {options}")
            return value
        array = numbers(value)
        shape, most = np.shape(self.default), HUGE if self.unit == "m" else np.inf
        shown = f"{mechanism}: {self.name} is {value} {self.unit}"
        if array.shape != shape or not (np.abs(array) < most).all():
            count = f"{shape[0]} finite numbers" if shape else "a finite number"
            below = f" below {most:g}" if most < np.inf else ""
            raise InputError(f"{shown}; give {count}{below}")
        if self.positive and not float(array) > 1.0 / HUGE:
            raise InputError(f"{shown}; give a length above 0, at least {1.0 / HUGE:g} m")
        if shape:
            return tuple(array.tolist())
        return value.item() if isinstance(value, np.generic) else value

    def read(self, mechanism: str, value: Any) -> Any:
        """Return a value in SI: text is read with its unit, other values are returned unchanged.

        Args:
            mechanism: name of the mechanism.
            value: text, a sequence that contains text, or a value in SI.

        Raises:
            InputError: for text that is no such value.
        """
        what = f"{self.name} of {mechanism}"
        if isinstance(value, tuple | list) and any(
            isinstance(component, str) for component in cast(list[Any], value)
        ):
            return tuple(units.si(component, self.unit, what) for component in cast(list[Any], value))
        if not isinstance(value, str):
            return value
        if self.options:
            return _option(what, self.options, value)
        if isinstance(self.default, tuple):
            values, count = units.parse_vector(value, self.unit, what), len(cast(tuple[Any], self.default))
            if len(values) != count:
                raise InputError(
                    f"{what} is {value!r}, {several(len(values), 'number')}; give {count} separated by commas"
                )
            return values
        number = units.parse(value, self.unit, what)
        if isinstance(self.default, int):
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


def components(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return numbers by name, a component of a point as in pivot.x."""
    result: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, tuple):
            pairs = zip(AXES, cast(tuple[Any, ...], value), strict=False)
            result |= {f"{name}.{axis}": number for axis, number in pairs}
        else:
            result[name] = value
    return result


def assembled_values(current: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return parameters from numbers by name; a component of a point is named as in pivot.x."""
    arguments: dict[str, Any] = {}
    for name, value in values.items():
        parameter, dot, axis = name.partition(".")
        present = arguments.get(parameter, current[parameter])
        if not dot:
            # a choice, such as an assembly mode, is a whole number
            whole = isinstance(present, int) and np.ndim(value) == 0 and float(value).is_integer()
            arguments[parameter] = type(present)(value) if whole else value
            continue
        point = list(present)
        point[AXES.index(axis)] = value
        arguments[parameter] = tuple(point)
    return arguments
