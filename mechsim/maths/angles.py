"""Angles: a full turn, and the laps on which they may be counted."""

import numpy as np

from mechsim.maths.arrays import Array

TURN = 2.0 * np.pi


def other_laps(angle: float, wanted: Array) -> list[int]:
    """Return the turns to add to an angle so that wanted ones (n,) lie within a turn of it, fewest first.

    All in [rad]; none is not among them.
    """
    first = int(np.ceil((wanted.max() - angle) / TURN - 1.0))
    last = int(np.floor((wanted.min() - angle) / TURN + 1.0))
    return sorted((laps for laps in range(first, last + 1) if laps), key=abs)
