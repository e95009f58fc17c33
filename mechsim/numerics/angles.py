"""Angles: a full turn, and the laps on which they may be counted."""

import numpy as np

from mechsim.numerics.arrays import Array

TURN = 2.0 * np.pi


def other_laps(angle: float, wanted: Array) -> list[int]:
    """Return the turns to add to an angle so that wanted ones (n,) lie within a turn of it, fewest first.

    All in [rad]; none is not among them.
    """
    first = int(np.ceil((wanted.max() - angle) / TURN - 1.0))
    last = int(np.floor((wanted.min() - angle) / TURN + 1.0))
    return sorted((laps for laps in range(first, last + 1) if laps), key=abs)


def turned_into(angles: Array, ends: tuple[float, float], start: float, period: float = TURN) -> Array:
    """Return angles (n,) turned back together so that all lie between two ends, as few turns as will do.

    As they are where none will. Where more than a turn lies between the ends an angle alone may have two
    places there; the angles of one motion belong together. All in [rad].

    Args:
        angles: of one motion.
        ends: of the range.
        start: an angle of it; turned back, angles lie within a turn of it.
        period: after which all is as before, whole turns.
    """
    low, high = ends
    for laps in (0, *other_laps(start, angles)):
        if laps % round(period / TURN) == 0:
            turned = angles - laps * TURN
            if low <= turned.min() and turned.max() <= high:
                return turned
    return angles
