"""Complex steps: a tiny imaginary part carries a derivative through arithmetic, without taking a difference.

Source: W. Squire and G. Trapp, Using complex variables to estimate derivatives of real functions, SIAM Review
40 (1998) 110-112.
"""

from typing import Any

import numpy as np

from mechsim.numerics.arrays import Array

# the imaginary part of a change of one: its square vanishes in rounding next to any real part
STEP = 2.0**-80


def stepped(value: Array, change: Array) -> Array:
    """Return values with changes as imaginary parts; what is reckoned from them changes by `change_of`."""
    complex_values: Any = value + 1j * STEP * change
    return complex_values


def change_of(value: Array) -> Array:
    """Return the derivative that values carry; zeros for real ones."""
    return np.imag(value) / STEP


def turn_of(sine: Array, cosine: Array) -> Array:
    """Return the angle of directions in (-pi, pi] rad, as arctan2 does, of complex steps too."""
    if not np.iscomplexobj(sine) and not np.iscomplexobj(cosine):
        return np.arctan2(sine, cosine)
    x, y = np.real(cosine), np.real(sine)
    across = x * np.imag(sine) - y * np.imag(cosine)
    return _joined(np.arctan2(y, x), across / (x**2 + y**2))


def unwrapped(angle: Array) -> Array:
    """Return angles without jumps of whole turns; changes as they are."""
    return _joined(np.unwrap(np.real(angle)), np.imag(angle)) if np.iscomplexobj(angle) else np.unwrap(angle)


def size_of(value: Array) -> Array:
    """Return values without their sign, and their changes with it."""
    return np.where(np.real(value) < 0.0, -value, value) if np.iscomplexobj(value) else np.abs(value)


def least_norm(matrix: Array, right: Array, rcond: float) -> Array:
    """Return least-norm solutions of equations that can be met, (n, m, k) and (n, m) -> (n, k).

    Args:
        matrix: of any rank, which its changes keep.
        right: sides.
        rcond: singular values below this fraction of the largest are zero.

    Source: G. Golub and V. Pereyra, The differentiation of pseudo-inverses and nonlinear least squares
    problems, SIAM Journal on Numerical Analysis 10 (1973) 413-432, for a residual of zero.
    """
    inverse = np.linalg.pinv(np.real(matrix), rcond=rcond)
    solution = inverse @ np.real(right)[..., None]
    if not np.iscomplexobj(matrix) and not np.iscomplexobj(right):
        return solution[..., 0]
    derivative = np.imag(matrix)
    moved = inverse @ (np.imag(right)[..., None] - derivative @ solution)
    aside = np.swapaxes(derivative, -1, -2) @ (np.swapaxes(inverse, -1, -2) @ solution)
    moved = moved + aside - inverse @ (np.real(matrix) @ aside)
    return _joined(solution[..., 0], moved[..., 0])


def null_space(matrix: Array, count: int, rcond: float) -> Array:
    """Return bases of the null spaces of matrices (n, m, k) of rank k - count, (n, k, count)."""
    right = np.linalg.svd(np.real(matrix), full_matrices=True)[2]
    basis = np.swapaxes(right[:, right.shape[1] - count :], -1, -2)
    if not np.iscomplexobj(matrix):
        return basis
    return _joined(basis, -np.linalg.pinv(np.real(matrix), rcond=rcond) @ (np.imag(matrix) @ basis))


def _joined(real: Array, imaginary: Array) -> Array:
    complex_values: Any = real + 1j * imaginary
    return complex_values
