"""Smooth interpolation of a table over time: value, rate and acceleration at any instant."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import numbers

# smallest number of rows that a quintic interpolates
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
            f"{what} holds numbers that are not finite, or times that do not rise; repair the table"
        )
    spline = make_interp_spline(time, value, k=5)
    rate, acceleration = spline.derivative(1), spline.derivative(2)
    return lambda t: (spline(t), rate(t), acceleration(t))
