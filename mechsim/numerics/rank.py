"""Numerical rank: nonzero singular values, null spaces, pseudo-inverses and least-norm solutions.

Matrices are scaled so that rows and unknowns have no units. Leading axes stack several matrices.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array

# singular values below this fraction of the largest are zero: between rounding (1e-16) and the 1e-6 of a
# configuration near a singular one
RANK_TOLERANCE = 1e-9
# singular values below this are zero too, 450 times the spacing of doubles at 1: equations can consist only
# of rounding, such as those of a ball joint at the common point of all axes of its loop
FLOOR = 1e-13
# number of rows from which those that are zero, as of a planar linkage, are left out, and scipy's QR pays:
# importing scipy.linalg takes 0.17 s of processor time, a fifth of a short command
MANY = 200
# least number of unknowns for which sparse systems of least norm take less time than whole ones: that of a
# single instant, as 50 instants at 20 unknowns take a fifth (`validation/speed/loop_speed.py`)
SPARSE = 40


def significant(
    values: NDArray[np.floating[Any]], tolerance: float = RANK_TOLERANCE, floor: float = FLOOR
) -> NDArray[np.bool_]:
    """Return which singular values, (..., k) in descending order, are nonzero.

    Args:
        values: singular values of scaled matrices.
        tolerance: values below this fraction of the largest are zero.
        floor: values below it are zero.
    """
    return values > np.maximum(tolerance * values[..., :1], floor)


def rank(matrix: Array, tolerance: float = RANK_TOLERANCE, floor: float = FLOOR) -> int:
    """Return the rank of a matrix, (m, k)."""
    values = np.linalg.svd(matrix[_relevant(matrix)], compute_uv=False)
    return int(significant(values, tolerance, floor).sum()) if values.size else 0


def _relevant(matrix: Array) -> Any:
    """Return an index of the rows of large matrices, (..., m, k), that are not all zero; else of all rows."""
    if matrix.shape[-2] < MANY:
        return ...
    return ..., matrix.any((*range(matrix.ndim - 2), -1)), slice(None)


def pivot_columns(matrix: Array) -> tuple[NDArray[np.intp], Array]:
    """Return the columns of a matrix, (m, k), in the order of QR with column pivoting, and its pivots' sizes.

    The first r columns are independent where r pivots are nonzero. Of many columns they are those of scipy.

    Source: Businger and Golub (1965), Linear least squares solutions by Householder transformations.

    Example:
        >>> pivot_columns(np.array([[1.0, 0.0, 3.0], [0.0, 2.0, 0.0]]))[0].tolist()
        [2, 1, 0]
    """
    if matrix.shape[1] >= MANY:
        from scipy import linalg

        routines: Any = linalg
        triangle, order = routines.qr(matrix, mode="r", pivoting=True)
        return order, np.abs(np.diagonal(triangle))
    rest, order = matrix.copy(), np.arange(matrix.shape[1])
    sizes = np.zeros(min(matrix.shape))
    for i in range(len(sizes)):
        norms = np.linalg.norm(rest[:, i:], axis=0)
        pivot = i + int(np.argmax(norms))
        sizes[i] = norms[pivot - i]
        if not sizes[i] > 0.0:
            break
        rest[:, [i, pivot]], order[[i, pivot]] = rest[:, [pivot, i]], order[[pivot, i]]
        direction = rest[:, i] / sizes[i]
        # the second projection removes the rounding of the first
        for _ in range(2):
            rest[:, i + 1 :] -= np.outer(direction, direction @ rest[:, i + 1 :])
    return order, sizes


def singular_values(matrix: Array) -> Array:
    """Return the singular values of matrices, (..., m, k), in descending order."""
    own = np.linalg.svd(matrix[_relevant(matrix)], compute_uv=False)
    values = np.zeros((*matrix.shape[:-2], min(matrix.shape[-2:])))
    values[..., : own.shape[-1]] = own
    return values


def right_vectors(matrix: Array) -> tuple[Array, Array]:
    """Return singular values and all k right singular vectors of matrices, (..., m, k)."""
    # all left ones of a row of a hundred loops would take thirty times as long
    matrix = matrix[_relevant(matrix)]
    _, values, vh = np.linalg.svd(matrix, full_matrices=matrix.shape[-2] < matrix.shape[-1])
    return values, vh


def null_space(matrix: Array, tolerance: float = RANK_TOLERANCE, floor: float = FLOOR) -> Array:
    """Return an orthonormal basis of the null space of a matrix of rank r, (m, k), as rows, (k - r, k)."""
    values, vh = right_vectors(matrix)
    return vh[int(significant(values, tolerance, floor).sum()) :]


def pseudo_inverse(matrix: Array, tolerance: float = RANK_TOLERANCE, floor: float = FLOOR) -> Array:
    """Return the pseudo-inverses, (..., k, m), of matrices, (..., m, k)."""
    u, values, vh = np.linalg.svd(matrix, full_matrices=False)
    nonzero = significant(values, tolerance, floor)
    inverse = np.where(nonzero, 1.0 / np.where(nonzero, values, 1.0), 0.0)
    result = np.swapaxes(vh, -1, -2) @ (inverse[..., None] * np.swapaxes(u, -1, -2))
    return np.asarray(result, dtype=np.float64)


def least_norm(matrix: Array, right: Array, tolerance: float = RANK_TOLERANCE, floor: float = FLOOR) -> Array:
    """Return the minimum-norm least-squares solutions, (..., k), of (..., m, k) x = (..., m)."""
    relevant = _relevant(matrix)
    if relevant is not ...:
        matrix, right = matrix[relevant], right[relevant[:2]]
    return (pseudo_inverse(matrix, tolerance, floor) @ right[..., None])[..., 0]


def least_squares(matrix: Array, right: Array) -> Array:
    """Return least-squares solutions (n, k) of matrices (n, m, k) of full column rank."""
    transposed = np.swapaxes(matrix, 1, 2)
    normal = transposed @ matrix
    scale = np.trace(normal, axis1=1, axis2=2)[:, None, None]
    normal += 1e-15 * scale * np.eye(matrix.shape[2])
    return np.linalg.solve(normal, transposed @ right[..., None])[..., 0]
