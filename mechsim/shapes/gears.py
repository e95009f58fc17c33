"""Gears: two toothed discs that mesh."""

import numpy as np

from mechsim.maths.arrays import Array
from mechsim.model.couplings import Gear
from mechsim.model.mechanism import GROUND, End
from mechsim.shapes.canvas import Canvas, upright_end
from mechsim.shapes.shape import Shape, pale, vector


def gear_pair(canvas: Canvas, gear: Gear) -> None:
    """Draw two toothed discs that mesh outside, behind the links, between shafts that stand parallel."""
    first, second = canvas.mechanism.joint(gear.driver), canvas.mechanism.joint(gear.driven)
    across = np.subtract(second.a.point, first.a.point)
    axis = np.asarray(first.a.axis)
    across = across - axis * (across @ axis)
    distance = float(np.linalg.norm(across))
    parallel = float(axis @ np.asarray(second.a.axis)) > 1.0 - 1e-9
    grounded = first.a.link == second.a.link == GROUND
    if not (grounded and parallel and gear.ratio < 0.0 and distance > 0.0):
        return
    fast = 1.0 / (1.0 + abs(gear.ratio))  # the driven gear's part of the distance
    teeth = max(18, round(18 / abs(gear.ratio)))
    counts = max(18, round(teeth * abs(gear.ratio))), teeth
    angles = [angle_in(joint.a, sign * across) for joint, sign in ((first, 1.0), (second, -1.0))]
    _gear(canvas, first.b, distance * (1.0 - fast), counts[0], angles[0])
    # at driver angle zero a gap of the driven gear meets a tooth of the driver
    turned = angles[1] - gear.phase + np.pi / counts[1]
    _gear(canvas, second.b, distance * fast, counts[1], turned)


def _gear(canvas: Canvas, end: End, radius: float, teeth: int, first: float) -> None:
    """Draw a toothed disc whose first tooth stands at an angle from the joint's mark."""
    colour = pale(canvas.colours[end.link])
    low = (canvas.back if canvas.normals else -4.5 * canvas.r) + 1.0 * canvas.r
    depth = 0.7 * np.pi * radius / teeth
    upright = upright_end(end, canvas.normals[end.link]) if canvas.normals else end
    canvas.disc(end.link, upright, low, low + 1.2 * canvas.r, radius - depth, colour)
    centre = np.asarray(end.point) + (low + 0.6 * canvas.r) * np.asarray(upright.axis)
    for angle in first + 2.0 * np.pi * np.arange(teeth) / teeth:
        out = end.frame @ np.array([np.cos(angle), np.sin(angle), 0.0])
        ends = centre + (radius - 1.3 * depth) * out, centre + (radius + 0.8 * depth) * out
        # a shade thinner than the disc, so that the faces do not fight where they overlap
        size = (0.42 * np.pi * radius / teeth, 0.57 * canvas.r)
        canvas.out[end.link].append(
            Shape("box", vector(ends[0]), vector(ends[1]), size, colour, upright.axis)
        )


def angle_in(end: End, direction: Array) -> float:
    """The angle of a direction about a joint's axis, from its mark."""
    x, y, _ = end.frame.T @ direction
    return float(np.arctan2(y, x))
