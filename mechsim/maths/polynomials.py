"""Polynomials in Chebyshev's form over [-1, 1]: fits, values, derivatives, integrals, of many columns."""

import numpy as np
from numpy.polynomial import Chebyshev, chebyshev

from mechsim.maths.arrays import Array


def fitted(x: Array, values: Array, degree: int) -> Array:
    """Return the coefficients (degree + 1, w) of polynomials through values (n, w) at x (n,) in [-1, 1]."""
    return np.asarray(chebyshev.chebfit(x, values, degree), dtype=np.float64)


def value(coefficients: Array, x: Array) -> Array:
    """Return polynomials at x (n,), (n, w)."""
    return np.asarray(chebyshev.chebval(x, coefficients), dtype=np.float64).T


def derivative(coefficients: Array, order: int = 1) -> Array:
    """Return the coefficients of a derivative by x."""
    return np.asarray(chebyshev.chebder(coefficients, order), dtype=np.float64)


def integral(x: Array, values: Array) -> Array:
    """Return the integral from x[0] to each x (n,), rising, of the polynomial through values (n,) there."""
    whole = Chebyshev.fit(x, values, len(x) - 1).integ(lbnd=x[0])
    return np.asarray(whole(x), dtype=np.float64)
