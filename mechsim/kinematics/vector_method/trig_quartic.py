"""Trigonometric polynomials of degree two: values, derivatives and real roots, by quartics in tan(t/2)."""

from typing import Any

import numpy as np

from mechsim.kinematics.vector_method.trig_polynomial import polynomial_roots
from mechsim.numerics.arrays import EPS, Array
from mechsim.numerics.jets import Values, cos_sin

# coefficients of 1, cos t, sin t, cos 2t, sin 2t; as an array (5, n)
Coefficients = tuple[Values | float, Values | float, Values | float, Values | float, Values | float]

# imaginary part of an eigenvalue below which it may be a double root split by rounding (1e-8)
NEARLY_REAL = 1e-5
# residual of a refined root, in units of the largest coefficient
MAX_RESIDUAL = 64.0 * EPS


def polynomial_value(coefficients: Array | Coefficients, t: Values) -> Any:
    """Return the polynomials at angles, (5, n) and (..., n) -> (..., n); jets if either is a jet."""
    c0, c1, s1, c2, s2 = coefficients
    c, s = cos_sin(t)
    return c0 - c2 + c * (c1 + 2.0 * (c2 * c + s2 * s)) + s1 * s


def derivative(coefficients: Array, t: Array) -> Array:
    """Return the derivatives of the polynomials by t at angles, (5, n) and (..., n) -> (..., n)."""
    _, c1, s1, c2, s2 = coefficients
    c, s = np.cos(t), np.sin(t)
    return s1 * c - c1 * s + 2.0 * (s2 * (c - s) * (c + s) - 2.0 * c2 * s * c)


def half_angle(coefficients: Array) -> Array:
    """Return the quartics in tan(t/2) that have the same roots, (5, n), highest power first."""
    c0, c1, s1, c2, s2 = coefficients
    return np.stack(
        [c0 - c1 + c2, 2.0 * s1 - 4.0 * s2, 2.0 * c0 - 6.0 * c2, 2.0 * s1 + 4.0 * s2, c0 + c1 + c2]
    )


def discriminant(coefficients: Array) -> Array:
    """Return a number that is zero where two roots coincide, (n,), in units of the coefficients.

    Negative with two real roots, positive with four or none.

    Source: I3 - 27 J2 of the invariants I and J of the binary quartic.
    """
    a, b, c, d, e = half_angle(coefficients / np.abs(coefficients).max(0))
    b, c, d = b / 4.0, c / 6.0, d / 4.0
    i = a * e - 4.0 * b * d + 3.0 * c * c
    j = a * (c * e - d * d) - b * (b * e - c * d) + c * (b * d - c * c)
    return i**3 - 27.0 * j * j


def real_roots(coefficients: Array) -> Array:
    """Return all real roots of polynomials of degree two.

    Args:
        coefficients: (5, n).

    Returns:
        Angles in (-pi, pi], (4, n), unordered; NaN for a pair that is not real.

    Accuracy: refined by Newton's method on the polynomial, so that the error is a few ulp of the largest
    coefficient divided by the derivative; half the digits are lost where two roots coincide.
    """
    scale = np.abs(coefficients).max(0)
    # the quartic's leading coefficient is the polynomial's value opposite the origin of the angle:
    # with the origin at its largest value, no root is lost at infinity
    angles = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    sizes = np.abs(polynomial_value(coefficients[:, None], angles[:, None]))  # (8, n)
    origin = angles[np.argmax(sizes, 0)] + np.pi
    quartic = half_angle(_rotated(coefficients, origin))
    tangents = polynomial_roots(quartic[::-1].T).T  # (4, n)
    roots = 2.0 * np.arctan(tangents.real) + origin
    nearly = np.abs(tangents.imag) < NEARLY_REAL * (1.0 + np.abs(tangents) ** 2)
    for _ in range(3):
        rise = derivative(coefficients, roots)
        step = polynomial_value(coefficients, roots) / np.where(rise == 0.0, np.inf, rise)
        roots = roots - np.clip(step, -1e-2, 1e-2)
    nearly &= np.abs(polynomial_value(coefficients, roots)) <= MAX_RESIDUAL * scale
    return np.where(nearly, np.pi - np.mod(np.pi - roots, 2.0 * np.pi), np.nan)


def _rotated(coefficients: Array, origin: Array) -> Array:
    """Return the polynomials of t - origin, (5, n)."""
    c0, c1, s1, c2, s2 = coefficients
    c, s = np.cos(origin), np.sin(origin)
    d, e = np.cos(2.0 * origin), np.sin(2.0 * origin)
    return np.stack([c0, c1 * c + s1 * s, s1 * c - c1 * s, c2 * d + s2 * e, s2 * d - c2 * e])
