"""Paths through places one after the other."""

import numpy as np

from mechsim.maths.arrays import Array

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
