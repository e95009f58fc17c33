"""Contact problems on arrays: linear complementarity, and friction in proportion to loads that it changes."""

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


# relative residual at the solution: rounding of the sums
ROUNDED = 1e-14
# largest number of iterations; Newton's method needs about six
MAX_ITERATIONS = 100
# fraction of the residual by which a step of Newton's method must reduce it
REDUCED = 0.5


def balanced_friction(constant: Array, base: Array, response: Array) -> tuple[Array, Array, Array]:
    """Return the friction x with x_k = c_k + sum over t of norm(base_kt + sum over j of response_ktj x_j).

    The right side changes by at most B times the change of x, with B_kj = sum over t of norm(response_ktj).
    If the spectral radius of B is below 1, it is a contraction: the solution exists and is unique, and the
    iteration converges to it (J. Ortega and W. Rheinboldt, Iterative Solution of Nonlinear Equations in
    Several Variables, 1970, section 13.1). Newton's method is faster. The right side is convex: for a single
    friction with a larger radius there are two solutions or none. Newton's method from zero finds the smaller
    one, at which the right side grows by less than the friction. The larger one is unstable if contacts yield
    at all: a load off by any amount grows (A. Oledzki, Modelling and simulation of self-locking drives,
    Mechanism and Machine Theory 30 (1995) 929-942).

    Args:
        constant: parts c of the frictions that do not depend on loads, (n, k).
        base: terms of the load of each friction without friction, (n, k, terms, 3).
        response: their changes by a unit of each friction, (n, k, terms, 3, k).

    Returns:
        Frictions (n, k), the spectral radius of B, (n,), and the residual relative to the largest friction,
        (n,), above `ROUNDED` where no solution was found.
    """
    n, k = base.shape[:2]
    bounds = np.sqrt((response**2).sum(3)).sum(2)
    radius = np.abs(np.linalg.eigvals(bounds)).max(1, initial=0.0)

    def image(x: Array) -> tuple[Array, Array]:
        """Return the right side and its derivative."""
        terms = base + np.einsum("nktcj,nj->nktc", response, x)
        sizes = np.sqrt((terms**2).sum(3))
        unit = terms / np.where(sizes > 0.0, sizes, 1.0)[..., None]
        return constant + sizes.sum(2), np.einsum("nktc,nktcj->nkj", unit, response)

    x = np.zeros((n, k))
    value, derivative = image(x)
    residual = _residual(x, value)
    for _ in range(MAX_ITERATIONS):
        if (residual <= ROUNDED).all():
            break
        matrix = np.eye(k) - derivative
        regular = np.abs(np.linalg.det(matrix)) > 0.0
        matrix = np.where(regular[:, None, None], matrix, np.eye(k))
        step: Array = np.linalg.solve(matrix, (value - x)[..., None])[..., 0].astype(np.float64)
        newton, simple = x + step, value
        after, after_derivative = image(newton)
        worse = ~(regular & (_residual(newton, after) <= REDUCED * residual) & (newton >= 0.0).all(1))
        other, other_derivative = image(simple)
        x = np.where(worse[:, None], simple, newton)
        value = np.where(worse[:, None], other, after)
        derivative = np.where(worse[:, None, None], other_derivative, after_derivative)
        residual = _residual(x, value)
    return x, radius, residual


def _residual(x: Array, value: Array) -> Array:
    """Return the relative residual, (n,)."""
    scale = np.maximum(np.abs(value).max(1, initial=0.0), np.finfo(np.float64).tiny)
    return np.abs(value - x).max(1, initial=0.0) / scale
