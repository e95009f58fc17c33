"""Arrays: type, checked numbers, rounding, error norms, polynomials, angles that differ by revolutions."""

from collections.abc import Iterable
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import InputError

Array = NDArray[np.float64]
Kind = TypeVar("Kind")
Number = TypeVar("Number", bound=np.generic)
REVOLUTION = 2.0 * np.pi
# spacing of floating-point numbers at 1
EPS = 2.0**-52
# largest residual of closed loops, in [rad] and characteristic lengths: Newton's method ends at about 1e-15
CLOSED = 1e-12
# difference of computed numbers, relative or in [rad], that is rounding: quantities of loops closed to 1e-12
# lose up to three digits by conditioning, and real differences are far larger
ROUNDING = 1e-9
# smallest divisor, which avoids a division by zero
TINY = 1e-300

# glibc returns freed memory to the system after each step of a calculation and requests it again for the
# next, page by page, unless one large array has been freed before; without this line that costs more than the
# calculation
np.empty(2_000_000)


def cross(a: Array, b: Array) -> Array:
    """Return vector products, (..., 3) and (..., 3) -> (..., 3)."""
    # np.cross spends ten times longer on moving axes than on multiplying
    out = np.empty(np.broadcast_shapes(a.shape, b.shape), np.result_type(a, b))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        out[..., i] = a[..., j] * b[..., k] - a[..., k] * b[..., j]
    return out


def distinct(points: ArrayLike, gap: float) -> list[Array]:
    """Return points (n, k) without those that coincide with an earlier one, within a gap."""
    kept: list[Array] = []
    for point in np.array(points, dtype=np.float64):
        if all(np.linalg.norm(point - other) > gap for other in kept):
            kept.append(point)
    return kept


def unique(values: NDArray[Number]) -> NDArray[Number]:
    """Return the distinct values of an array, ascending."""
    # without a second result, numpy.unique imports numpy.ma, which takes longer than a solution of a six-bar
    return np.unique(values, return_index=True)[0]


def scattered(count: int, number: int) -> Array:
    """Return numbers between -1 and 1 without a pattern, (count,); those of other numbers differ."""
    # importing numpy.random takes longer than a solution, too; squares times 0.6 rad never repeat an angle
    return np.cos(0.6 * number * np.arange(1, count + 1) ** 2)


def worst(errors: ArrayLike) -> float:
    """Return the largest absolute value of errors; infinity if one is NaN, 0 if there is none."""
    sizes = np.abs(np.asarray(errors, dtype=np.float64))
    return float(np.where(np.isnan(sizes), np.inf, sizes).max(initial=0.0))


def rms(errors: ArrayLike) -> float:
    """Return the root mean square of errors; infinity if one is NaN, 0 if there is none."""
    values = np.asarray(errors, dtype=np.float64)
    if not values.size:
        return 0.0
    largest = worst(values)
    # scaled, so that squares neither overflow nor underflow
    if largest in (0.0, np.inf):
        return largest
    return largest * float(np.sqrt(np.mean((values / largest) ** 2)))


def polynomial(coefficients: Iterable[float], x: Array) -> tuple[Array, Array, Array]:
    """Return a polynomial and its first two derivatives at values (n,), by Horner's scheme.

    Args:
        coefficients: from the constant up.
        x: values, which may have complex steps.
    """
    value, rate, half = np.zeros_like(x), np.zeros_like(x), np.zeros_like(x)
    for entry in reversed([*coefficients]):
        half, rate, value = half * x + rate, rate * x + value, value * x + entry
    return value, rate, 2.0 * half


def wrapped(angles: Array) -> Array:
    """Return angles in [rad], of any shape, within half a revolution of zero."""
    return angles - REVOLUTION * np.round(angles / REVOLUTION)


def other_revolutions(angle: float, targets: Array) -> list[int]:
    """Return revolutions to add to an angle so that targets (n,) lie within a revolution of it, fewest first.

    Angles are in [rad]; zero revolutions are omitted.
    """
    first = int(np.ceil((targets.max() - angle) / REVOLUTION - 1.0))
    last = int(np.floor((targets.min() - angle) / REVOLUTION + 1.0))
    return sorted((count for count in range(first, last + 1) if count), key=abs)


def shifted_into(angles: Array, ends: tuple[float, float], start: float, period: float = REVOLUTION) -> Array:
    """Return angles (n,) shifted together by the fewest whole revolutions that bring them into a range.

    They are unchanged if no shift fits. All values are in [rad].

    Args:
        angles: angles of a motion.
        ends: ends of the range.
        start: an angle in the range; shifted angles lie within a revolution of it.
        period: angle, a multiple of a revolution, after which the configuration repeats.
    """
    low, high = ends
    for count in (0, *other_revolutions(start, angles)):
        if count % round(period / REVOLUTION) == 0:
            shifted = angles - count * REVOLUTION
            if low <= shifted.min() and shifted.max() <= high:
                return shifted
    return angles


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
