"""Toothed wheels: discs, rings with teeth inside, and cones, as they are drawn."""

from dataclasses import dataclass

import numpy as np

from mechsim.model.joints import End
from mechsim.model.links import GROUND
from mechsim.numerics.arrays import Array
from mechsim.shapes.canvas import Canvas, upright_end
from mechsim.shapes.shape import HOUSING, Rgba, Shape, pale, vector

Place = tuple[str, float]
# part of a bevel gear's slant that its teeth take
FACE = 0.3


@dataclass(frozen=True, slots=True)
class Cone:
    """On what cone the teeth of a bevel gear lie.

    Attributes:
        apex: height of its tip over the joint's point along the axis, in [m].
        height: of the wheel's back over the tip, in [m].
    """

    apex: float
    height: float


@dataclass(frozen=True, slots=True)
class Wheel:
    """A toothed wheel.

    Attributes:
        end: of the joint about whose axis it lies.
        radius: of the circle on which it meshes, in [m].
        teeth: how many it has.
        first: angle of one of them from the joint's mark, in [rad].
        way: +1, or -1 for the one of a pair that turns against the other, both about their own axes.
        hollow: whether it is a ring with teeth inside.
        cone: of a bevel gear, on what its teeth lie.
    """

    end: End
    radius: float
    teeth: int
    first: float
    way: float = 1.0
    hollow: bool = False
    cone: Cone | None = None

    @property
    def place(self) -> Place:
        """Link and radius, to six digits: what tells wheels apart."""
        return self.end.link, float(f"{self.radius:.5e}")


def draw_wheel(canvas: Canvas, wheel: Wheel) -> None:
    """Draw a toothed disc, or a ring with teeth inside, behind all links; a bevel gear where it lies.

    What turns with a link hangs on it by a hub, a ring by a disc behind its teeth.
    """
    if wheel.cone is not None:
        _bevel(canvas, wheel, wheel.cone)
        return
    end, radius, teeth = wheel.end, wheel.radius, wheel.teeth
    colour, low = wheel_colour(canvas, end.link), wheel_height(canvas) - 0.6 * canvas.r
    depth = 0.7 * np.pi * radius / teeth
    upright = upright_end(end, canvas.normals[end.link]) if canvas.normals else end
    centre = np.asarray(end.point) + wheel_height(canvas) * np.asarray(upright.axis)
    inner, outer = radius - 1.3 * depth, radius + 0.8 * depth
    if wheel.hollow:
        inner, outer = radius - 0.8 * depth, radius + 1.3 * depth
        _rim(canvas, end.link, centre, upright, (radius + depth, 0.6 * canvas.r, teeth), colour)
    else:
        canvas.disc(end.link, upright, low, low + 1.2 * canvas.r, radius - depth, colour)
    if end.link != GROUND:
        _hub(canvas, upright, (low, radius + depth), wheel.hollow, colour)
    for angle in wheel.first + 2.0 * np.pi * np.arange(teeth) / teeth:
        out = end.frame @ np.array([np.cos(angle), np.sin(angle), 0.0])
        # a shade thinner than the disc, so that the faces do not fight where they overlap
        size = (0.42 * np.pi * radius / teeth, 0.57 * canvas.r)
        ends = vector(centre + inner * out), vector(centre + outer * out)
        canvas.out[end.link].append(Shape("box", *ends, size, colour, upright.axis))


def _hub(canvas: Canvas, end: End, sizes: tuple[float, float], hollow: bool, colour: Rgba) -> None:
    """Draw what joins a wheel to its link: from its back at a height, of a radius in [m]."""
    low, radius = sizes
    if hollow:
        low -= 0.3 * canvas.r
        canvas.disc(end.link, end, low, low + 0.6 * canvas.r, radius, colour)
    canvas.disc(end.link, end, low, canvas.height(end.link), min(2.9 * canvas.r, 0.7 * radius), colour)


def wheel_colour(canvas: Canvas, link: str) -> Rgba:
    """Return the colour of the teeth of a link."""
    return pale(canvas.colours[link]) if link in canvas.colours else HOUSING


def wheel_height(canvas: Canvas) -> float:
    """Return the height over a shaft's point at which wheels between parallel shafts mesh, in [m]."""
    return (canvas.back if canvas.normals else -4.5 * canvas.r) + 1.6 * canvas.r


def _bevel(canvas: Canvas, wheel: Wheel, cone: Cone) -> None:
    """Draw a bevel gear: its back, its hub, a shaft to the joint, and teeth that point at the cone's tip."""
    end, colour = wheel.end, wheel_colour(canvas, wheel.end.link)
    axis, point = np.asarray(end.axis), np.asarray(end.point)
    back, front = cone.apex + cone.height, cone.apex + (1.0 - FACE) * cone.height
    depth, rear = 0.7 * np.pi * wheel.radius / wheel.teeth, back + np.copysign(0.8 * canvas.r, cone.height)
    root = wheel.radius - depth
    for one, other, radius in (
        (back, rear, root),
        (front, back, (1.0 - FACE) * root),
        (0.0, rear, canvas.r),
    ):
        canvas.disc(end.link, end, min(one, other), max(one, other), radius, colour)
    slant = float(np.hypot(wheel.radius, cone.height))
    for angle in wheel.first + 2.0 * np.pi * np.arange(wheel.teeth) / wheel.teeth:
        out = end.frame @ np.array([np.cos(angle), np.sin(angle), 0.0])
        heel = cone.height * axis + wheel.radius * out
        across = vector((wheel.radius * axis - cone.height * out) / slant)
        tip = point + cone.apex * axis
        ends = vector(tip + (1.0 - FACE) * heel), vector(tip + heel)
        size = (0.42 * np.pi * (1.0 - 0.5 * FACE) * wheel.radius / wheel.teeth, depth)
        canvas.out[end.link].append(Shape("box", *ends, size, colour, across))


def _rim(
    canvas: Canvas, link: str, centre: Array, end: End, sizes: tuple[float, float, int], colour: Rgba
) -> None:
    """Draw a ring of so many bars: inner radius, half a thickness, bars."""
    inner, thick, bars = sizes
    half = 1.2 * canvas.r
    for angle in 2.0 * np.pi * np.arange(bars) / bars:
        c, s = np.cos(angle), np.sin(angle)
        out, along = end.frame @ np.array([c, s, 0.0]), end.frame @ np.array([-s, c, 0.0])
        # long enough that their outer corners meet
        reach = (inner + 2.0 * half) * np.tan(np.pi / bars)
        middle = centre + (inner + half) * out
        ends = vector(middle - reach * along), vector(middle + reach * along)
        canvas.out[link].append(Shape("box", *ends, (half, thick), colour, end.axis))


def teeth_on(radius: float, pitch: float) -> int:
    """Return how many teeth a wheel has of which each takes `pitch` of a radius."""
    return max(1, round(radius / pitch))


def angle_in(end: End, direction: Array) -> float:
    """Return the angle of a direction about a joint's axis, from its mark."""
    x, y, _ = end.frame.T @ direction
    return float(np.arctan2(y, x))
