"""A planar link held by three legs: leg vectors, Jacobian, closing, motion.

Link 4 of a class III triad carries three points; each is tied by a leg of given length to a pivot
whose place is known. Points of the plane are complex numbers, x + iy. A pose of the link is its
place (of the origin of its frame) and its turn exp(i theta). Whatever concerns the three legs is a
sequence of three, of numbers, arrays or jets, so that the same few lines serve one pose, a hundred
thousand, and their motion.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from mechsim.analytic.vector_method.jets import revalued, still
from mechsim.analytic.vector_method.plane import cross

Three = Sequence[Any]  # one entry a leg: complex or float, number or array


def leg_vectors(place: Any, turn: Any, pivots: Three, platform: Three) -> Any:
    """Return the legs, from pivot to link, a complex (3, ...)."""
    return [place + turn * b - a for a, b in zip(pivots, platform, strict=True)]


def moments(legs: Three, turn: Any, platform: Three) -> Any:
    """Return the moment of each leg vector about the origin of the link's frame, (3, ...)."""
    return [(leg * (turn * b).conjugate()).imag for leg, b in zip(legs, platform, strict=True)]


def determinant(legs: Three, arms: Three) -> Any:
    """Return the determinant of the rows (leg_x, leg_y, moment): zero where the triad is singular.

    It vanishes exactly when the three lines of the legs meet in a point or are parallel.
    """
    (l1, l2, l3), (m1, m2, m3) = legs, arms
    return m1 * cross(l2, l3) + m2 * cross(l3, l1) + m3 * cross(l1, l2)


def inverse(legs: Three, arms: Three) -> tuple[Any, Any]:
    """Return the columns of the inverse of the rows (leg_x, leg_y, moment).

    Column k is how link 4 moves if leg k alone grows, at the rate 1/leg: shift (complex) and turning.
    """
    (l1, l2, l3), (m1, m2, m3) = legs, arms
    whole = determinant(legs, arms)
    shift = [
        1j * (l3 * m2 - l2 * m3) / whole,
        1j * (l1 * m3 - l3 * m1) / whole,
        1j * (l2 * m1 - l1 * m2) / whole,
    ]
    return shift, [cross(l2, l3) / whole, cross(l3, l1) / whole, cross(l1, l2) / whole]


def close(place: Any, turn: Any, pivots: Three, platform: Three, legs: Three, steps: int) -> tuple[Any, Any]:
    """Close the legs by Newton's method, each start on its own; returns place and turn."""
    with np.errstate(all="ignore"):
        for _ in range(steps):
            vectors = leg_vectors(place, turn, pivots, platform)
            # (|leg|^2 - r^2)/2 by factors, which keeps the digits of a gap that is nearly closed
            gaps = [
                0.5 * (abs(leg) - length) * (abs(leg) + length)
                for leg, length in zip(vectors, legs, strict=True)
            ]
            shift, turning = inverse(vectors, moments(vectors, turn, platform))
            place = place - sum(column * gap for column, gap in zip(shift, gaps, strict=True))
            swing = sum(column * gap for column, gap in zip(turning, gaps, strict=True))
            turn = turn * (1.0 - 1j * swing)
            turn = turn / abs(turn)
    return place, turn


def carried(place: Any, turn: Any, pivots: Three, platform: Three, legs: Three) -> tuple[Any, Any]:
    """Return a closed pose as jets, from the pivots as jets: two Newton steps, which give one rate each."""
    moved = close(still(place), still(turn), pivots, platform, legs, steps=2)
    return revalued(moved[0], place), revalued(moved[1], turn)
