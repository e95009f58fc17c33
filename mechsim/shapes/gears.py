"""Gears: toothed wheels that mesh, on the frame or on an arm that carries them, and standing rings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mechsim.maths.arrays import Array
from mechsim.model.couplings import Gear
from mechsim.model.mechanism import End, Joint, Mechanism
from mechsim.shapes.canvas import Canvas, upright_end
from mechsim.shapes.shape import HOUSING, Rgba, Shape, pale, vector

# teeth of the smallest wheel
FEWEST = 18
Place = tuple[str, float]


@dataclass(frozen=True, slots=True)
class Wheel:
    """A toothed wheel.

    Attributes:
        end: of the joint about whose axis it lies.
        radius: of the circle on which it meshes, in [m].
        teeth: how many it has.
        first: angle of one of them from the joint's mark, in [rad].
        hollow: whether it is a ring with teeth inside.
    """

    end: End
    radius: float
    teeth: int
    first: float
    hollow: bool = False

    @property
    def place(self) -> Place:
        """Link and radius, to six digits: what tells wheels apart."""
        return self.end.link, float(f"{self.radius:.5e}")


def draw_gears(canvas: Canvas) -> None:
    """Draw the wheels of all gears between parallel shafts, each wheel once, behind the links."""
    mechanism, drawn = canvas.mechanism, dict[Place, Wheel]()
    pitch = _pitch([wheel.radius for gear in mechanism.gears for wheel in wheels_of(mechanism, gear)])
    for gear in mechanism.gears:
        for wheel in _meshing(wheels_of(mechanism, gear, pitch), drawn):
            if wheel.place not in drawn:
                drawn[wheel.place] = wheel
                _draw(canvas, wheel)


def _pitch(radii: Sequence[float]) -> float:
    """Return the part of a radius a tooth takes such that all wheels have nearly whole numbers of teeth."""
    if not radii:
        return 1.0
    counts = np.arange(FEWEST, 3 * FEWEST)
    teeth = np.outer(counts, radii) / min(radii)
    off = np.abs(teeth - np.round(teeth)).max(1).round(6)
    return min(radii) / float(counts[np.argmin(off)])


def _meshing(pair: Sequence[Wheel], drawn: Mapping[Place, Wheel]) -> Sequence[Wheel]:
    """Return a pair turned so that the one which is drawn already has its teeth where they are."""
    for one, other in (pair, pair[::-1]) if pair else ():
        if one.place in drawn:
            off = (drawn[one.place].first - one.first) * one.teeth / other.teeth
            return [replace(other, first=other.first + (off if one.hollow or other.hollow else -off))]
    return pair


def wheels_of(mechanism: Mechanism, gear: Gear, pitch: float = 1.0) -> list[Wheel]:
    """Return both wheels of a gear, none where shafts are not parallel or do not turn as wheels would.

    A tooth takes `pitch` of a radius, in [m].
    """
    first, second = mechanism.joint(gear.driver), mechanism.joint(gear.driven)
    if first.a.link == second.a.link:
        return _side_by_side(first, second, gear, pitch)
    if first.b.link == second.a.link:
        return _on_an_arm(first, second, gear, pitch)
    return []


def _side_by_side(first: Joint, second: Joint, gear: Gear, pitch: float) -> list[Wheel]:
    """Two wheels whose shafts the same link carries, meshing outside."""
    across, distance = _apart(first.a, second.a)
    if not (_parallel(first.a, second.a) and gear.ratio < 0.0 and distance > 0.0):
        return []
    fast = 1.0 / (1.0 + abs(gear.ratio))  # the driven gear's part of the distance
    radii = distance * (1.0 - fast), distance * fast
    angles = [angle_in(joint.a, sign * across) for joint, sign in ((first, 1.0), (second, -1.0))]
    # at driver angle zero a gap of the driven gear meets a tooth of the driver
    counts = [_teeth(radius, pitch) for radius in radii]
    turned = angles[1] - gear.phase + np.pi / counts[1]
    return [Wheel(first.b, radii[0], counts[0], angles[0]), Wheel(second.b, radii[1], counts[1], turned)]


def _on_an_arm(arm: Joint, planet: Joint, gear: Gear, pitch: float) -> list[Wheel]:
    """A planet on the arm that drives it, and the wheel that stands where the arm's shaft does.

    Seen from the arm that wheel turns back as far as the arm turns: inside a ring the planet turns back as
    well, round a wheel it turns on.
    """
    across, distance = _apart(arm.b, planet.a)
    ratio = -gear.ratio if _parallel(arm.b, planet.a) else 0.0
    part = ratio - 1.0 if ratio > 0.0 else 1.0 - ratio
    if not (ratio and part > 0.0 and distance > 0.0):
        return []
    radius = distance / part
    teeth, standing = _teeth(radius, pitch), _teeth(abs(ratio) * radius, pitch)
    # at nought of both joints a tooth of the planet points at the wheel that stands, which has a gap there
    out = np.asarray(arm.a.frame) @ np.asarray(arm.b.frame).T @ across
    first = angle_in(planet.a, across) - gear.phase
    gap = angle_in(arm.a, out) + np.pi / standing
    return [
        Wheel(planet.b, radius, teeth, first if ratio > 0.0 else first + np.pi),
        Wheel(arm.a, abs(ratio) * radius, standing, gap, hollow=ratio > 0.0),
    ]


def _teeth(radius: float, pitch: float) -> int:
    return max(1, round(radius / pitch))


def _apart(a: End, b: End) -> tuple[Array, float]:
    """Return the vector from one shaft to another of the same link, across the first, and its length."""
    across, axis = np.subtract(b.point, a.point), np.asarray(a.axis)
    across = across - axis * (across @ axis)
    return across, float(np.linalg.norm(across))


def _parallel(a: End, b: End) -> bool:
    return float(np.asarray(a.axis) @ np.asarray(b.axis)) > 1.0 - 1e-9


def _draw(canvas: Canvas, wheel: Wheel) -> None:
    """Draw a toothed disc, or a ring with teeth inside, in the layer behind all links."""
    end, radius, teeth = wheel.end, wheel.radius, wheel.teeth
    colour = pale(canvas.colours[end.link]) if end.link in canvas.colours else HOUSING
    low = (canvas.back if canvas.normals else -4.5 * canvas.r) + 1.0 * canvas.r
    depth = 0.7 * np.pi * radius / teeth
    upright = upright_end(end, canvas.normals[end.link]) if canvas.normals else end
    centre = np.asarray(end.point) + (low + 0.6 * canvas.r) * np.asarray(upright.axis)
    inner, outer = radius - 1.3 * depth, radius + 0.8 * depth
    if wheel.hollow:
        inner, outer = radius - 0.8 * depth, radius + 1.3 * depth
        _rim(canvas, end.link, centre, upright, (radius + depth, 0.6 * canvas.r, teeth), colour)
    else:
        canvas.disc(end.link, upright, low, low + 1.2 * canvas.r, radius - depth, colour)
    for angle in wheel.first + 2.0 * np.pi * np.arange(teeth) / teeth:
        out = end.frame @ np.array([np.cos(angle), np.sin(angle), 0.0])
        # a shade thinner than the disc, so that the faces do not fight where they overlap
        size = (0.42 * np.pi * radius / teeth, 0.57 * canvas.r)
        ends = vector(centre + inner * out), vector(centre + outer * out)
        canvas.out[end.link].append(Shape("box", *ends, size, colour, upright.axis))


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


def angle_in(end: End, direction: Array) -> float:
    """Return the angle of a direction about a joint's axis, from its mark."""
    x, y, _ = end.frame.T @ direction
    return float(np.arctan2(y, x))
