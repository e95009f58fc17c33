"""Roots s of det(s2 M + s C + K) = 0, each with an error bound, also slow roots next to fast ones.

Sources: D. A. Bini and V. Noferini, Solving polynomial eigenvalue problems by means of the Ehrlich-Aberth
method, Linear Algebra and its Applications 439 (2013) 1130-1149; F. Tisseur, Backward error and condition of
polynomial eigenvalue problems, Linear Algebra and its Applications 309 (2000) 339-361.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import EPS, Array

# a bound contains this multiple of the rounding of one operation
ROUNDING = 8.0 * EPS
# most iterations; from the eigenvalues of the companion matrix few are needed, near a multiple root many
ITERATIONS = 60

Complex = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Roots:
    """Roots of a quadratic eigenvalue problem.

    Attributes:
        values: the roots, (k,).
        errors: bound of each error, (k,).
        vectors: right eigenvectors, (k, n).
    """

    values: Complex
    errors: Array
    vectors: Complex


def quadratic_roots(damping: Array, stiffness: Array, error: Array, zeros: int = 0) -> Roots:
    """Return the 2 n roots of s2 I + s C + K and their eigenvectors, the exact zeros first.

    Newton's method on the determinant with implicit deflation (Ehrlich and Aberth) refines the eigenvalues of
    the companion matrix, in which slow roots are lost by rounding of the fast ones: s <- s - 1 / (t - sum of
    1 / (s - other roots)) with t = trace((s2 I + s C + K)^-1 (2 s I + C)). The bound of an error is the
    effect of the errors of C and K on a simple root with left vector y and right vector x,
    |y|' (|s| |dC| + |dK|) |x| / |y* (2 s I + C) x|; on a double root its square root.

    Args:
        damping: C, (n, n).
        stiffness: K, (n, n).
        error: bounds of the errors of K, (n, n).
        zeros: number of roots that are zero because K is singular.
    """
    n, unit = len(stiffness), np.eye(len(stiffness))
    companion = np.block([[np.zeros((n, n)), unit], [-stiffness, -damping]])
    values = np.asarray(np.linalg.eigvals(companion), np.complex128)
    values = values[np.argsort(np.abs(values))]
    values[:zeros] = 0.0
    active = np.arange(2 * n) >= zeros
    for _ in range(ITERATIONS):
        step = np.zeros(2 * n, np.complex128)
        for i in np.flatnonzero(active).tolist():
            step[i] = _aberth_step(damping, stiffness, values, i)
        values -= step
        active &= np.abs(step) > 2.0 * EPS * np.abs(values)
        if not active.any():
            break
    # the roots of real matrices: imaginary parts that are rounding removed, pairs made conjugate
    real = np.abs(values.imag) <= np.sqrt(EPS) * np.abs(values)
    alone = [k for k in np.flatnonzero(real).tolist() if np.abs(values - values[k].conjugate()).argmin() == k]
    values = values.copy()
    values[alone] = values[alone].real
    matrices = values[:, None, None] ** 2 * unit + values[:, None, None] * damping + stiffness
    left, _, right = np.linalg.svd(matrices)
    x, y = right[:, -1].conj(), left[:, :, -1]
    change = ROUNDING * np.abs(values)[:, None, None] * np.abs(damping) + error + ROUNDING * np.abs(stiffness)
    effect = np.einsum("ki,kij,kj->k", np.abs(y), change, np.abs(x))
    derivative = np.abs(np.einsum("ki,kij,kj->k", y.conj(), 2.0 * values[:, None, None] * unit + damping, x))
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.fmin(effect / derivative, np.sqrt(effect)) + ROUNDING * np.abs(values)
    errors[:zeros] = 0.0
    return Roots(values, errors, x)


def _aberth_step(damping: Array, stiffness: Array, values: Complex, i: int) -> complex:
    """Return the step of one root; zero where the matrix is singular, as at an exact root."""
    s, unit = values[i], np.eye(len(stiffness))
    others = s - np.delete(values, i)
    with np.errstate(all="ignore"):
        try:
            newton = np.trace(
                np.linalg.solve(s * s * unit + s * damping + stiffness, 2.0 * s * unit + damping)
            )
        except np.linalg.LinAlgError:
            return 0j
        step = 1.0 / (newton - (1.0 / others[others != 0.0]).sum())
    return complex(step) if np.isfinite(step) else 0j
