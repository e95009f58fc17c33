"""Which singular values of loop equations tell something: none beside the largest, nor in rounding alone."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.maths.arrays import Array

# singular values below this part of the largest count as zero: between the 1e-16 of rounding and
# the 1e-6 or so of a mechanism that is merely near a dead centre
RANK_TOLERANCE = 1e-9
# and those below this at all, rows and unknowns being in units of the size: a ball at the point through which
# all axes of its loop pass leaves rows of rounding and no others. 450 times the spacing of numbers at one
FLOOR = 1e-13


def significant(
    values: NDArray[np.floating[Any]], told: float = RANK_TOLERANCE, floor: float = FLOOR
) -> NDArray[np.bool_]:
    """Return which singular values, (..., k) falling, are more than nought.

    Args:
        values: of equations in units of the size.
        told: those below this part of the largest are nought.
        floor: so are those below it.
    """
    return values > np.maximum(told * values[..., :1], floor)


def rank(matrix: Array, told: float = RANK_TOLERANCE) -> int:
    """Return the rank of equations in units of the size, (rows, unknowns)."""
    return int(significant(np.linalg.svd(matrix, compute_uv=False), told).sum())


def relative_cutoff(matrix: Array, told: float = RANK_TOLERANCE, floor: float = FLOOR) -> Array:
    """Return below which part of the largest singular values of equations are left out of a solution, (...).

    Args:
        matrix: (..., rows, unknowns) in units of the size.
        told: what the part is where the equations are more than rounding.
        floor: below which they are rounding.
    """
    largest = np.abs(matrix).max((-2, -1), initial=floor)
    return np.maximum(told, floor / largest)
