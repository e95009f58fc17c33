"""Goals and limits: functions of a motion's quantities and of dimensions, with exact derivatives.

A function is given columns as `mechsim solve` and `mechsim dynamics` name them, and dimensions by name; their
derivatives go through its own arithmetic as tiny imaginary parts (see `numerics.complex_step`). It may
take sums, products, powers, sines, roots; of the largest or the absolute value use `largest`, `smallest`,
`size_of` here.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array

Quantities = Mapping[str, Any]
Function = Callable[[Quantities], Any]


@dataclass(frozen=True)
class Goal:
    """What is to be small: the sum of squares of a function's values.

    Attributes:
        of: quantities that it needs (see `studies.sensitivity.columns_of`).
        function: quantities and dimensions -> a number or numbers, in any unit.
    """

    of: tuple[str, ...]
    function: Function


@dataclass(frozen=True)
class Limit:
    """What must be kept: low <= function <= high, at each of its values.

    Attributes:
        of: quantities that it needs; none where dimensions are enough.
        function: quantities and dimensions -> a number or numbers.
        low: bound from below; None for none.
        high: bound from above.
        name: for messages.
    """

    of: tuple[str, ...]
    function: Function
    low: float | None = None
    high: float | None = None
    name: str = "a limit"

    def __post_init__(self) -> None:
        if self.low is None and self.high is None:
            raise InputError(f"{self.name} has no bound; give low, high or both")


def largest(values: Array) -> Any:
    """Return the largest of values, with its derivative."""
    return values[int(np.argmax(np.real(values)))]


def smallest(values: Array) -> Any:
    """Return the smallest of values, with its derivative."""
    return values[int(np.argmin(np.real(values)))]


def numbers_from(found: Any, what: str) -> Array:
    """Return what a function gave as one row of numbers.

    Raises:
        InputError: for what is no number.
    """
    values = np.atleast_1d(np.asarray(found)).ravel()
    if values.dtype.kind not in "fciu" or not np.isfinite(values).all():
        raise InputError(f"{what} gives {found!r}; return finite numbers")
    return values


def bounded(limits: Sequence[Limit]) -> list[tuple[Limit, float, float]]:
    """Return limits as signs and bounds: sign * (function - bound) >= 0."""
    found = [(one, 1.0, one.low) for one in limits if one.low is not None]
    return found + [(one, -1.0, one.high) for one in limits if one.high is not None]
