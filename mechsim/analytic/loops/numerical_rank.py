"""Numerical rank of loop equations: singular values above a relative and an absolute tolerance."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array

# singular values below this part of the largest count as zero: between the 1e-16 of rounding and
# the 1e-6 or so of a mechanism that is merely near a dead centre
RANK_TOLERANCE = 1e-9
# and those below this at all, rows and unknowns being in units of the size: a ball at the point through which
# all axes of its loop pass leaves rows of rounding and no others. 450 times the spacing of numbers at one
FLOOR = 1e-13


def significant(
    values: NDArray[np.floating[Any]], tolerance: float = RANK_TOLERANCE, floor: float = FLOOR
) -> NDArray[np.bool_]:
    """Return which singular values, (..., k) falling, are not zero numerically.

    Args:
        values: of equations in units of the size.
        tolerance: those below this fraction of the largest are zero.
        floor: so are those below it.
    """
    return values > np.maximum(tolerance * values[..., :1], floor)


def rank(matrix: Array, tolerance: float = RANK_TOLERANCE) -> int:
    """Return the rank of equations in units of the size, (rows, unknowns)."""
    return int(significant(np.linalg.svd(matrix, compute_uv=False), tolerance).sum())


def relative_cutoff(matrix: Array, tolerance: float = RANK_TOLERANCE, floor: float = FLOOR) -> Array:
    """Return the cutoff of singular values relative to the largest, for pseudo-inverses, (...).

    Args:
        matrix: (..., rows, unknowns) in units of the size.
        tolerance: the cutoff where the equations exceed rounding.
        floor: below which they are rounding.
    """
    largest = np.abs(matrix).max((-2, -1), initial=floor)
    return np.maximum(tolerance, floor / largest)
