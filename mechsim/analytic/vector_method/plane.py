"""Vectors of a plane as complex numbers x + iy, single, in arrays or in jets."""

from typing import Any

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet


def flat(point: Array) -> Any:
    """Return (n, 3) points as complex numbers x + iy, (n,)."""
    return point[..., 0] + 1j * point[..., 1]


def xyz(point: Any) -> Any:
    """Return points of the plane as (3, n) vectors."""
    if isinstance(point, Jet):
        return Jet(xyz(point.value), xyz(point.rate), xyz(point.second))
    return np.stack([point.real, point.imag, np.zeros_like(point.real)])


def dot(u: Any, v: Any) -> Any:
    """Return the scalar product of plane vectors."""
    return u.real * v.real + u.imag * v.imag


def cross(u: Any, v: Any) -> Any:
    """Return the vector product of plane vectors, its component across the plane."""
    return u.real * v.imag - u.imag * v.real
