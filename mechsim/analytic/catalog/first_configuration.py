"""The first configuration of a motion, at which the sign of an assembly applies."""

from collections.abc import Sequence

import numpy as np

from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array

# crank angles within this of a change point, in [rad], are that change point
AT_POINT = 1e-9
# distance in [rad] from a change point to the configuration that counts as right after it
AFTER = 1e-6


def first_sign_angle(angles: Array, change_points: Sequence[float], direction: float) -> float:
    """Return the crank angle at which a sign applies: the first, or right after it at a change point.

    Args:
        angles: crank angles in the order of the motion, (n,) in [rad].
        change_points: in [rad], of any revolution.
        direction: sign of the crank's motion, where the angles are all one.
    """
    first = float(angles[0])
    distance = first - np.asarray(change_points)
    if np.abs(distance - TURN * np.round(distance / TURN)).min() > AT_POINT:
        return first
    displacement = angles - first
    moved = displacement[np.abs(displacement) > AT_POINT]
    ahead = float(moved[0]) if len(moved) else direction
    return first + (-AFTER if ahead < 0.0 else AFTER)


def segment(
    angle: float, change_points: Sequence[float], arc: tuple[float, float] | None
) -> tuple[float, float]:
    """Return the interval of crank angles around one angle that is free of change points, in [rad].

    Args:
        angle: in [rad], not a change point.
        change_points: in [rad], of any revolution.
        arc: reachable interval that bounds it; None for a crank that turns fully.
    """
    points = np.asarray(change_points)
    below = points + TURN * np.floor((angle - points) / TURN)
    low, high = float(below.max()), float((below + TURN).min())
    return (low, high) if arc is None else (max(low, arc[0]), min(high, arc[1]))
