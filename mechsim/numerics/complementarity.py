"""Contact problems on arrays: linear complementarity, and friction in proportion to loads that it changes."""

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import TINY, Array

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
# random loads whose directions begin the search where there may be several solutions: they find all stable
# ones of 229 states of random linkages, and of 399 of 400 random equations of two to four frictions
STARTS = 64
# growth of the frictions from their start at which there is no solution
UNBOUNDED = 1e12
# relative difference of equal solutions
EQUAL = 1e-6


def balanced_friction(constant: Array, base: Array, response: Array) -> tuple[Array, Array, NDArray[np.int_]]:
    """Return the friction x with x_k = c_k + sum over t of norm(base_kt + sum over j of response_ktj x_j).

    The right side F(x) changes by at most B times the change of x, B_kj = sum over t of norm(response_ktj).
    If the spectral radius of B is below 1, it is a contraction: the solution exists and is unique (J. Ortega
    and W. Rheinboldt, Iterative Solution of Nonlinear Equations in Several Variables, 1970, section 13.1).
    Otherwise there may be none or several; for a single friction there are two or none, and Newton's method
    from zero finds the smaller one, which is stable. Contacts yield, so that a load that is off changes by
    x' = F(x) - x: a solution is unstable if an eigenvalue of F' has a real part of 1 or more (A. Oledzki,
    Modelling and simulation of self-locking drives, Mechanism and Machine Theory 30 (1995) 929-942). Stable
    solutions are searched from random directions of the loads.

    Args:
        constant: parts c of the frictions that do not depend on loads, (n, k).
        base: terms of the load of each friction without friction, (n, k, terms, 3).
        response: their changes by a unit of each friction, (n, k, terms, 3, k).

    Returns:
        Frictions (n, k), the spectral radius of B, (n,), and the number of stable solutions, (n,).
    """
    n, k = base.shape[:2]
    bounds = np.sqrt((response**2).sum(3)).sum(2)
    radius = np.abs(np.linalg.eigvals(bounds)).max(1, initial=0.0)
    x, solved = newton(constant, base, response, np.zeros((n, k)))
    number = solved.astype(np.int_)
    random = np.random.default_rng(0).normal(size=(STARTS, 1, 1, k + 1, 1))
    for i in np.flatnonzero((radius >= 1.0) & (k > 1)):
        terms = (np.concatenate([base[i, ..., None], response[i]], -1) @ random)[..., 0]
        unit = terms / np.maximum(np.sqrt((terms**2).sum(3, keepdims=True)), TINY)
        matrix = np.eye(k) - np.einsum("nktc,ktcj->nkj", unit, response[i])
        loads = constant[i] + np.einsum("nktc,ktc->nk", unit, base[i])
        start = np.abs(np.linalg.solve(matrix, loads[..., None])[..., 0])
        start[0] = x[i]
        state = constant[i : i + 1], base[i : i + 1], response[i : i + 1]
        solution, solved = newton(*state, start)
        solution = solution[solved]
        stable = solution[np.linalg.eigvals(_image(*state, solution)[1]).real.max(1) < 1.0]
        x[i] = stable[0] if len(stable) else x[i]
        others = np.abs(stable - x[i]).max(1) > EQUAL * np.abs(x[i]).max()
        number[i] = min(1, len(stable)) + int(others.any())
    return x, radius, number


def _image(constant: Array, base: Array, response: Array, x: Array) -> tuple[Array, Array]:
    """Return the right side F, (n, k), and its derivative, (n, k, k)."""
    terms = base + (response @ x[:, None, None, :, None])[..., 0]
    sizes = np.sqrt((terms**2).sum(3))
    unit = terms / np.where(sizes > 0.0, sizes, 1.0)[..., None]
    return constant + sizes.sum(2), (unit[..., None, :] @ response)[..., 0, :].sum(2)


def newton(constant: Array, base: Array, response: Array, x: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return what Newton's method, or else the iteration, finds from x, and whether that solves it, (n,)."""
    value, derivative = _image(constant, base, response, x)
    residual, largest = _residual(x, value), UNBOUNDED * np.abs(value).max(1, initial=0.0)
    identity = np.eye(x.shape[1])
    for _ in range(MAX_ITERATIONS):
        moving = (residual > ROUNDED) & (x.max(1, initial=0.0) <= largest)
        if not moving.any():
            break
        regular = np.abs(np.linalg.det(identity - derivative)) > 0.0
        matrix = np.where(regular[:, None, None], identity - derivative, identity)
        step = x + np.linalg.solve(matrix, (value - x)[..., None])[..., 0]
        after = _residual(step, _image(constant, base, response, step)[0])
        better = regular & (after <= REDUCED * residual) & (step >= 0.0).all(1)
        x = np.where(moving[:, None], np.where(better[:, None], step, value), x)
        value, derivative = _image(constant, base, response, x)
        residual = _residual(x, value)
    return x, residual <= ROUNDED


def _residual(x: Array, value: Array) -> Array:
    """Return the relative residual, (n,)."""
    scale = np.maximum(np.abs(value).max(1, initial=0.0), TINY)
    return np.abs(value - x).max(1, initial=0.0) / scale
