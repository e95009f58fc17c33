"""The array type of the package, error norms, and tangents of paths."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

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
