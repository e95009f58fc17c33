"""Linear complementarity problems with a symmetric, positive semidefinite matrix."""

import numpy as np

from mechsim.numerics.arrays import Array

# eigenvalues of the matrix, whose rows are scaled to at most 1, that are rounding; and distance of scaled
# constraints that conflict, whose solution would be 1e7 times the right-hand side
ROUNDING, CONFLICT = 1e-12, 1e-7


def complementary(matrix: Array, constant: Array) -> Array | None:
    """Return z with 0 <= z, 0 <= A z + b and z' (A z + b) = 0, with independent columns where z > 0.

    A = F F' and x = F' z, the shortest vector with F x + b >= 0; z are its multipliers, by nonnegative least
    squares. A z + b is unique, z only if A is regular.

    Source: C. L. Lawson, R. J. Hanson, Solving Least Squares Problems (1974), chapter 23 (problem LDP).

    Args:
        matrix: A, (k, k), with elements of at most about 1.
        constant: b, (k,).

    Returns:
        z, (k,); None without a solution.

    Example:
        >>> complementary(np.eye(2), np.array([-3.0, 1.0]))
        array([3., 0.])
    """
    from scipy.optimize import nnls

    largest = float(np.abs(constant).max(initial=0.0))
    if not (constant < 0.0).any():
        return np.zeros(len(constant))
    values, vectors = np.linalg.eigh(matrix)
    factor = vectors * np.sqrt(np.where(values > ROUNDING, values, 0.0))
    rows = np.concatenate([factor.T, -constant[None] / largest])
    target = np.append(np.zeros(len(constant)), 1.0)
    weights, distance = nnls(rows, target)
    # the residual (x, -1) / (1 + x' x) vanishes if no x is admissible
    if distance <= CONFLICT or weights.max() >= 1.0 / CONFLICT:
        return None
    return weights * (largest / distance**2)


def least_in_box(matrix: Array, linear: Array) -> Array:
    """Return f with |f_i| <= 1 that minimises f' A f / 2 + f' b, by bounded least squares; A f is unique.

    Source: C. L. Lawson, R. J. Hanson, Solving Least Squares Problems (1974, 1995), appendix C.2 (BVLS).

    Args:
        matrix: A, (k, k), symmetric and positive semidefinite.
        linear: b, (k,), of which the part outside the range of A does not count.

    Returns:
        f, (k,).

    Example:
        >>> least_in_box(np.eye(2), np.array([-3.0, 0.5]))
        array([ 1. , -0.5])
    """
    from scipy.optimize import lsq_linear

    values, vectors = np.linalg.eigh(matrix)
    kept = values > ROUNDING * values[-1]
    roots, basis = np.sqrt(values[kept]), vectors[:, kept].T
    if not len(roots):
        return np.zeros(len(linear))
    target = -(basis @ linear) / roots
    return np.asarray(lsq_linear(roots[:, None] * basis, target, (-1.0, 1.0), method="bvls").x)
