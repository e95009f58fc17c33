"""The largest value of a function with one peak between the arguments of a grid."""

from collections.abc import Callable

import numpy as np

from mechsim.numerics.arrays import Array

# points of a finer grid about a peak, and number of grids
PEAK_POINTS, PEAK_GRIDS = 33, 8


def peak(function: Callable[[Array], Array], grid: Array) -> tuple[float, float]:
    """Return where a function is largest, or NaN, and its value there.

    Each grid of `PEAK_POINTS` lies between the neighbours of the largest value of the one before.

    Args:
        function: arguments (n,) -> values (n,).
        grid: rising arguments between which it has one peak at most, (n,).

    Accuracy: of the argument 1e-9 of the distance of its neighbours, of a smooth function's value rounding.
    """
    largest, argument = -np.inf, np.nan
    for _ in range(PEAK_GRIDS):
        values = function(grid)
        i = int(np.argmax(values))
        if not values[i] <= largest:
            largest, argument = float(values[i]), float(grid[i])
        if np.isnan(largest):
            break
        grid = np.linspace(grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)], PEAK_POINTS)
    return argument, largest
