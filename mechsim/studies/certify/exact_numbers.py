"""Exact numbers for proofs that an equation holds identically: rational constants and unknown values.

Arrays of these numbers are numpy arrays of objects. A product with an exact zero is an exact zero for any
other factor, so that the equations of a planar linkage normal to its plane evaluate to zero exactly.
"""

from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

ExactArray = NDArray[np.object_]


class Unknown:
    """A number with an unknown value."""

    def _combined(self, _: object) -> "Unknown":
        return self

    __add__ = __radd__ = __sub__ = __rsub__ = _combined

    def __neg__(self) -> "Unknown":
        return self

    def __mul__(self, other: object) -> object:
        return 0 if other == 0 else self

    __rmul__ = __mul__


UNKNOWN = Unknown()


def rational(values: ArrayLike, radius: ArrayLike = 0.0) -> ExactArray:
    """Return floating-point numbers as fractions; numbers with a radius above zero are unknown."""
    numbers, radii = np.broadcast_arrays(np.asarray(values, dtype=np.float64), radius)
    entries: list[Any] = [
        UNKNOWN if rad > 0.0 else Fraction(float(number))
        for number, rad in zip(numbers.ravel(), radii.ravel(), strict=True)
    ]
    out = np.empty(len(entries), dtype=object)
    out[:] = entries
    return out.reshape(numbers.shape)


def unknown_numbers(*shape: int) -> ExactArray:
    """Return an array of unknown numbers."""
    out = np.empty(shape, dtype=object)
    out.fill(UNKNOWN)
    return out


def exact_unit_vector(vector: ExactArray) -> ExactArray:
    """Return a column (3, 1) divided by its length; it is exact along a coordinate axis."""
    nonzero = [value for value in vector.ravel() if value != 0]
    alone = len(nonzero) == 1 and nonzero[0] is not UNKNOWN
    entries = [
        0 if value == 0 else (1 if value > 0 else -1) if alone else UNKNOWN for value in vector.ravel()
    ]
    out = np.empty(3, dtype=object)
    out[:] = entries
    return out.reshape(3, 1)
