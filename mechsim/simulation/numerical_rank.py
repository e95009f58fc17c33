"""Numerical rank: which singular values of a loop Jacobian are above rounding."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array

# singular values below this fraction of the largest count as zero; entries below the floor, in radians and
# characteristic lengths, are rounding: a ball joint at the common point of all axes of its loop leaves
# constraint rows of rounding only
RANK_TOLERANCE, FLOOR = 1e-9, 1e-13


def significant(values: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
    """Return which singular values, (..., k) in descending order, of a scaled Jacobian are nonzero."""
    return values > np.maximum(RANK_TOLERANCE * values[..., :1], FLOOR)


def pseudo_inverse(matrix: Array) -> Array:
    """Return the pseudo-inverses, (n, k, m), of scaled Jacobians, (n, m, k)."""
    left, values, right = np.linalg.svd(matrix, full_matrices=False)
    kept = significant(values)
    inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    found = np.swapaxes(right, -1, -2) @ (inverse[..., None] * np.swapaxes(left, -1, -2))
    return np.asarray(found, dtype=np.float64)
