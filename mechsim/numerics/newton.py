"""The root of a function between two places where its sign differs."""

from collections.abc import Callable
from typing import Any


def root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return where a function vanishes, to rounding; by Brent's method."""
    from scipy import optimize

    brent: Any = optimize.brentq
    # where a function is as flat as a cube at its root a hundred steps are too few
    return float(brent(function, low, high, xtol=1e-300, rtol=1e-15, maxiter=1000))
