"""Polynomials in Chebyshev's form over [-1, 1]: fits, values, derivatives, integrals, of many columns."""

import numpy as np
from numpy.polynomial import chebyshev

from mechsim.maths.arrays import Array


def fitted(x: Array, values: Array) -> Array:
    """Return the coefficients (n, w) of the polynomials through values (n, w) at x (n,) in [-1, 1].

    Raises:
        LinAlgError: where two x are one.
    """
    return np.linalg.solve(chebyshev.chebvander(x, len(x) - 1), values).astype(np.float64, copy=False)


def smoothed(x: Array, values: Array, degree: int) -> Array:
    """Return the coefficients (degree + 1, w) of the polynomials nearest to values (n, w) at x (n,)."""
    return np.linalg.lstsq(chebyshev.chebvander(x, degree), values)[0].astype(np.float64, copy=False)


def value(coefficients: Array, x: Array) -> Array:
    """Return polynomials at x (n,), (n, w)."""
    return np.asarray(chebyshev.chebval(x, coefficients), dtype=np.float64).T


def derivative(coefficients: Array, order: int = 1) -> Array:
    """Return the coefficients of a derivative by x."""
    return np.asarray(chebyshev.chebder(coefficients, order), dtype=np.float64)


def integral(x: Array, values: Array) -> Array:
    """Return the integral from x[0] to each x (n,), rising, of the polynomial through values (n,) there.

    Raises:
        LinAlgError: where two x are one.
    """
    half = 0.5 * (x[-1] - x[0])
    scaled = (x - x[0]) / half - 1.0
    whole = np.asarray(chebyshev.chebint(fitted(scaled, values[:, None]), lbnd=-1.0), dtype=np.float64)
    return half * value(whole, scaled)[:, 0]
