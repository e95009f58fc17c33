"""Polynomials in Chebyshev's form over [-1, 1]: fits, values, derivatives, integrals, of many columns."""

from collections.abc import Callable

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import numbers


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


# the fewest rows of which a quintic goes through all
LEAST_ROWS = 6


def quintic_spline(
    what: str, time: ArrayLike, value: ArrayLike
) -> Callable[[Array], tuple[Array, Array, Array]]:
    """Return the quintic spline through a table, as times (n,) -> value, rate and acceleration, (n,) each.

    Args:
        what: the table is, for messages.
        time: rising, (n,) in [s], at least `LEAST_ROWS` values.
        value: (n,).

    Raises:
        InputError: for columns of unequal length, too few rows, what is not finite, or times that fall.
    """
    from scipy.interpolate import make_interp_spline

    time, value = numbers(time), numbers(value)
    if time.shape != value.shape or time.ndim != 1 or len(time) < LEAST_ROWS:
        raise InputError(
            f"{what} has {time.shape} times and {value.shape} values; give two columns of equal length, "
            f"at least {LEAST_ROWS} rows"
        )
    if not (np.isfinite(time).all() and np.isfinite(value).all() and (np.diff(time) > 0.0).all()):
        raise InputError(
            f"{what} holds numbers that are not finite, or times that do not rise; mend the table"
        )
    spline = make_interp_spline(time, value, k=5)
    rate, acceleration = spline.derivative(1), spline.derivative(2)
    return lambda t: (spline(t), rate(t), acceleration(t))
