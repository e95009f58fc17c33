"""An analytic side that is a function of the crank angle: its rates by differences."""

from collections.abc import Callable, Mapping

import numpy as np

from mechsim.errors import InputError
from mechsim.model.motion import Motion, PointMotion
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import numbers

PointFunction = Callable[[Array], Mapping[str, Array]]

# central differences of order eight for first and second derivatives, at 0, +-1 ... +-4
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
SPACING = 0.01  # rad: rounding 1e-14 and truncation 1e-16 x (harmonic)^9 balance for smooth motions


def differentiated(function: PointFunction, angle: Array, speed: Array, acceleration: Array) -> Motion:
    """Return the motion of a function's points at crank angles, speeds and accelerations, (n,) each.

    Raises:
        InputError: unless it gives points of the right shape.
    """
    around = [function(angle + k * SPACING) for k in range(-4, 5)]
    points: dict[str, PointMotion] = {}
    if not isinstance(around[4], Mapping):  # pyright: ignore[reportUnnecessaryIsInstance]
        raise InputError(
            f"the function gives a {type(around[4]).__name__}; give a dictionary from points to places (n, 3)"
        )
    for name in around[4]:
        parts = [numbers(one[name]) for one in around]
        if {part.shape for part in parts} != {(len(angle), 3)}:
            raise InputError(
                f"the function gives point {name!r} of shape {parts[4].shape} for {len(angle)} crank "
                f"angles; give ({len(angle)}, 3)"
            )
        values = np.stack(parts)
        first = np.tensordot(FIRST, values, 1) / SPACING
        second = np.tensordot(SECOND, values, 1) / SPACING**2
        points[name] = PointMotion(
            values[4], first * speed[:, None], second * speed[:, None] ** 2 + first * acceleration[:, None]
        )
    return Motion("user", angle, speed, acceleration, points)
