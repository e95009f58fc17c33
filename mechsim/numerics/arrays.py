"""The array of the house, and memory that its arrays find again."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

# glibc hands memory back to the system after each step of a calculation, to take it page by page again for
# the next, until it has seen an array of some size come and go: else that costs more than the calculation
np.empty(2_000_000)


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


# part of a path's extent by which its ends may be apart and it is closed
CLOSED = 1e-6


def tangents(places: Array) -> Array:
    """Return unit vectors along a path of places (n, k), (n, k); nought where it stands.

    Of a path that ends where it began, both ends share the one across the joint.
    """
    along = np.gradient(places, axis=0)
    extent = np.ptp(places, axis=0).max()
    if len(places) > 2 and np.abs(places[-1] - places[0]).max() <= CLOSED * extent:
        along[[0, -1]] = 0.5 * (places[1] - places[-2])
    length = np.sqrt((along**2).sum(1, keepdims=True))
    return along / np.where(length > 0.0, length, 1.0)
