"""Derivatives by central differences, with an estimate of their error."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mechsim.numerics.arrays import Array

# first step, ratio of successive steps, and their number: the smallest step is 1e-6 of the unit
FIRST, RATIO, STEPS = 0.03, 0.25, 8


def extrapolated_derivative(difference: Callable[[float], Array]) -> tuple[Array, Array]:
    """Return a derivative by Richardson extrapolation of central differences, and the estimate of its error.

    Each entry has its own best step: the one at which successive extrapolations agree best, between the
    truncation error of long steps and the rounding of short ones.

    Args:
        difference: step -> central difference quotient, an array.

    Source: C. J. F. Ridders, Accurate computation of F'(x) and F'(x) F''(x), Advances in Engineering Software
    4 (1982) 75-76.

    Example:
        >>> value, _ = extrapolated_derivative(lambda h: (np.exp(h) - np.exp(-h)) / (2.0 * h))
        >>> bool(abs(value - 1.0) < 1e-12)
        True
    """
    previous = [np.asarray(difference(FIRST))]
    best, error = previous[0], np.full(previous[0].shape, np.inf)
    for level in range(1, STEPS):
        row = [np.asarray(difference(FIRST * RATIO**level))]
        for order, coarse in enumerate(previous, start=1):
            row.append(row[-1] + (row[-1] - coarse) / (RATIO ** (-2 * order) - 1.0))
            change = np.fmax(np.abs(row[-1] - row[-2]), np.abs(row[-1] - coarse))
            better = change < error
            best, error = np.where(better, row[-1], best), np.where(better, change, error)
        previous = row
    return best, error
