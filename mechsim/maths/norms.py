"""Sizes of errors in which what is not a number counts as infinite."""

import numpy as np
from numpy.typing import ArrayLike


def worst(errors: ArrayLike) -> float:
    """Return the largest size among errors; infinity where one is not a number, 0 where there is none."""
    sizes = np.abs(np.asarray(errors, dtype=np.float64))
    return float(np.where(np.isnan(sizes), np.inf, sizes).max(initial=0.0))


def rms(errors: ArrayLike) -> float:
    """Return the root mean square of errors; infinity where one is not a number, 0 where there is none."""
    values = np.asarray(errors, dtype=np.float64)
    if not values.size:
        return 0.0
    largest = worst(values)
    # scaled, so that squares neither overflow nor vanish
    if largest in (0.0, np.inf):
        return largest
    return largest * float(np.sqrt(np.mean((values / largest) ** 2)))
