"""Which singular values of a model's loops tell something: none beside the largest, nor in rounding alone."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.maths.arrays import Array

# singular values below this part of the largest count as zero; and slopes below this, in radians and sizes,
# are rounding: a ball at the point through which all axes of its loop pass leaves rows of nothing else
RANK_TOLERANCE, FLOOR = 1e-9, 1e-13


def significant(values: NDArray[np.floating[Any]]) -> NDArray[np.bool_]:
    """Return which singular values, (..., k) falling, of slopes in radians and sizes are more than nought."""
    return values > np.maximum(RANK_TOLERANCE * values[..., :1], FLOOR)


def pseudo_inverse(matrix: Array) -> Array:
    """Return pseudo-inverses, (n, k, m), of slopes in radians and sizes, (n, m, k)."""
    left, values, right = np.linalg.svd(matrix, full_matrices=False)
    kept = significant(values)
    inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    found = np.swapaxes(right, -1, -2) @ (inverse[..., None] * np.swapaxes(left, -1, -2))
    return np.asarray(found, dtype=np.float64)
