"""Angles: a revolution, and angles that differ by whole revolutions."""

import numpy as np

from mechsim.numerics.arrays import Array

REVOLUTION = 2.0 * np.pi


def wrapped(angles: Array) -> Array:
    """Return angles in [rad], of any shape, within half a revolution of zero."""
    return angles - REVOLUTION * np.round(angles / REVOLUTION)


def other_revolutions(angle: float, targets: Array) -> list[int]:
    """Return revolutions to add to an angle so that targets (n,) lie within a revolution of it, fewest first.

    Angles are in [rad]; zero revolutions are omitted.
    """
    first = int(np.ceil((targets.max() - angle) / REVOLUTION - 1.0))
    last = int(np.floor((targets.min() - angle) / REVOLUTION + 1.0))
    return sorted((count for count in range(first, last + 1) if count), key=abs)


def shifted_into(angles: Array, ends: tuple[float, float], start: float, period: float = REVOLUTION) -> Array:
    """Return angles (n,) shifted together by the fewest whole revolutions that bring them into a range.

    They are unchanged if no shift fits. All values are in [rad].

    Args:
        angles: angles of a motion.
        ends: ends of the range.
        start: an angle in the range; shifted angles lie within a revolution of it.
        period: angle, a multiple of a revolution, after which the configuration repeats.
    """
    low, high = ends
    for count in (0, *other_revolutions(start, angles)):
        if count % round(period / REVOLUTION) == 0:
            shifted = angles - count * REVOLUTION
            if low <= shifted.min() and shifted.max() <= high:
                return shifted
    return angles
