"""Checked inputs: numbers, with NaN for anything else, and values of a type."""

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError

Kind = TypeVar("Kind")

# largest magnitude of a number; larger ones are errors of the unit or the exponent, and their squares
# overflow
HUGE = 1e30


def number(value: object) -> float:
    """Return a real number as a float; NaN for text, None, lists and other values."""
    values = numbers(value)
    return float(values) if values.ndim == 0 else float("nan")


def numbers(value: object) -> NDArray[np.float64]:
    """Return real numbers, nested or not, as an array of their shape; a single NaN for other values."""
    try:
        array = np.asarray(value)
        if array.dtype.kind in "biuf" or (array.dtype.kind == "O" and array.size == 0):
            return array.astype(np.float64)
    except (TypeError, ValueError):
        pass
    return np.array(np.nan)


def at_least_zero(what: str, value: float) -> None:
    """Raise InputError for a negative, huge or no number."""
    if not 0.0 <= number(value) < HUGE:
        raise InputError(f"{what} is {value}; give a finite number, 0 or more, below {HUGE:g}")


def units_remedy(value: object, example: str) -> str:
    """Return the end of an error message for text instead of a number in SI; empty for other values."""
    return f"; convert text by {example}" if isinstance(value, str) else ""


def require(what: str, value: object, kind: type[Kind]) -> Kind:
    """Return a value of a type; raise InputError for any other."""
    if not isinstance(value, kind):
        raise InputError(f"{what} is of type {type(value).__name__}; give one of type {kind.__name__}")
    return value
