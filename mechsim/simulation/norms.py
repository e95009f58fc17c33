"""Sizes of errors in which what is not a number counts as infinite."""

import numpy as np
from numpy.typing import ArrayLike


def worst(errors: ArrayLike) -> float:
    """Return the largest size among errors; infinity where one is not a number, 0 where there is none."""
    sizes = np.abs(np.asarray(errors, dtype=np.float64))
    return float(np.where(np.isnan(sizes), np.inf, sizes).max(initial=0.0))


def rms(values: ArrayLike) -> float:
    """Return the root mean square of values, of which there is at least one."""
    return float(np.sqrt(np.mean(np.square(np.asarray(values, dtype=np.float64)))))
