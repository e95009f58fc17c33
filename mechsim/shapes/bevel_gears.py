"""Bevel gears: two wheels whose shafts meet, carried by the same link."""

import numpy as np

from mechsim.model.joints import End
from mechsim.numerics.arrays import Array
from mechsim.shapes.wheels import Cone, Wheel, angle_in, teeth_on

# axes that pass each other at less than this part of a rod's radius meet
MEETS = 1e-3
# sine of the angle between axes below which they are parallel
PARALLEL = 1e-6
# slant of wheels whose joints both lie where the shafts meet, in radii of rods
SLANT = 9.0
Ends = tuple[End, End]


def bevel_pair(
    first: Ends, second: Ends, rates: tuple[float, float], phase: float, rod: float, pitch: float
) -> list[Wheel]:
    """Return two wheels whose shafts meet, none where these are parallel or pass each other.

    Seen from the link that carries both, wheels of rates w1 and w2 about axes u1 and u2 roll on each other
    along the direction of w1 u1 - w2 u2. The wheels lie where their joints do, as far as they can.

    Args:
        first: of the first wheel's joint, the end on the link that carries both, and the wheel's own.
        second: of the second wheel's.
        rates: of both wheels about their axes, seen from that link.
        phase: angle of the second joint where the first is at zero, in [rad].
        rod: radius of rods in [m].
        pitch: part of a radius that a tooth takes, in [m].
    """
    carriers, own = zip(first, second, strict=True)
    apex = _meeting(*carriers, MEETS * rod)
    axes = np.array([end.axis for end in carriers])
    along = rates[0] * axes[0] - rates[1] * axes[1]
    length = float(np.linalg.norm(along))
    if apex is None or not length > 0.0:
        return []
    along /= length
    tips = np.array([(apex - end.point) @ axis for end, axis in zip(carriers, axes, strict=True)])
    cosines = axes @ along
    sines = np.linalg.norm(np.cross(axes, along), axis=1)
    if not sines.min() > PARALLEL:
        return []
    along, cosines, slant = _side(along, cosines, -tips, SLANT * rod)
    counts = [teeth_on(slant * sine, pitch) for sine in sines]
    angles = [angle_in(end, along) for end in carriers]
    # where the first joint is at zero a tooth of its wheel meets a gap of the other
    starts = angles[0], angles[1] - phase + np.pi / counts[1]
    ways = 1.0, float(np.sign(rates[0] * rates[1]))
    cones = [Cone(tip, slant * cosine) for tip, cosine in zip(tips.tolist(), cosines.tolist(), strict=True)]
    return [
        Wheel(own[i], slant * float(sines[i]), counts[i], starts[i], ways[i], cone=cones[i]) for i in range(2)
    ]


def _side(along: Array, cosines: Array, heights: Array, least: float) -> tuple[Array, Array, float]:
    """Return the line of contact to the side where the joints lie, its cosines, and its length in [m].

    Heights are those of the joints over the point where the shafts meet; a wheel as flat as a plate may lie
    anywhere.
    """
    bent = np.abs(cosines) > PARALLEL
    slants = np.divide(heights, cosines, out=np.zeros(2), where=bent)
    far, near = sorted(slants.tolist(), key=abs, reverse=True)
    nearest = near if far * near > 0.0 else far
    if abs(nearest) < least:
        nearest = least if nearest >= 0.0 else -least
    sense = float(np.sign(nearest))
    return sense * along, sense * cosines, abs(nearest)


def _meeting(a: End, b: End, far: float) -> Array | None:
    """Return where the axes of two joints meet, (3,); None where they are parallel or farther apart."""
    across = np.cross(a.axis, b.axis)
    square = float(across @ across)
    if not square > PARALLEL**2:
        return None
    off = np.subtract(b.point, a.point)
    if abs(float(off @ across)) > far * square**0.5:
        return None
    return a.point + np.asarray(a.axis) * float(np.cross(off, b.axis) @ across / square)
