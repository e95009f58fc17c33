"""Gears: pairs of toothed wheels that mesh, on the frame or on an arm that carries them, and racks."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mechsim.model.couplings import Gear
from mechsim.model.joints import End, Joint
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.shapes.bevel_gears import bevel_pair
from mechsim.shapes.body import rod_radius
from mechsim.shapes.canvas import Canvas
from mechsim.shapes.racks import draw_racks
from mechsim.shapes.wheels import Place, Wheel, angle_in, draw_wheel, teeth_on

# teeth of the smallest wheel
FEWEST = 18


def draw_gears(canvas: Canvas) -> None:
    """Draw the wheels of all gears whose shafts are parallel or meet, each wheel once, and all racks."""
    mechanism, drawn = canvas.mechanism, dict[Place, Wheel]()
    pitch = _pitch([wheel.radius for gear in mechanism.gears for wheel in wheels_of(mechanism, gear)])
    for gear in mechanism.gears:
        for wheel in _meshing(wheels_of(mechanism, gear, pitch), drawn):
            if wheel.place not in drawn:
                drawn[wheel.place] = wheel
                draw_wheel(canvas, wheel)
    draw_racks(canvas, FEWEST)


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
            return [replace(other, first=other.first + one.way * other.way * off)]
    return pair


def wheels_of(mechanism: Mechanism, gear: Gear, pitch: float = 1.0) -> list[Wheel]:
    """Return both wheels of a gear, none where shafts pass each other or do not turn as wheels would.

    A tooth takes `pitch` of a radius, in [m].
    """
    first, second = mechanism.joint(gear.driver), mechanism.joint(gear.driven)
    if first.a.link == second.a.link:
        found = _side_by_side(first, second, gear, pitch)
        rates, ends = (1.0, gear.ratio), (first.a, first.b)
    elif first.b.link == second.a.link:
        found = _on_an_arm(first, second, gear, pitch)
        rates, ends = (-1.0, gear.ratio), (first.b, first.a)
    else:
        return []
    if found or not rates[1]:
        return found
    return bevel_pair(ends, (second.a, second.b), rates, gear.phase, rod_radius(mechanism), pitch)


def _side_by_side(first: Joint, second: Joint, gear: Gear, pitch: float) -> list[Wheel]:
    """Two wheels whose shafts the same link carries, meshing outside."""
    across, distance = _apart(first.a, second.a)
    if not (_parallel(first.a, second.a) and gear.ratio < 0.0 and distance > 0.0):
        return []
    fast = 1.0 / (1.0 + abs(gear.ratio))  # the driven gear's part of the distance
    radii = distance * (1.0 - fast), distance * fast
    angles = [angle_in(joint.a, sign * across) for joint, sign in ((first, 1.0), (second, -1.0))]
    # at driver angle zero a gap of the driven gear meets a tooth of the driver
    counts = [teeth_on(radius, pitch) for radius in radii]
    turned = angles[1] - gear.phase + np.pi / counts[1]
    return [
        Wheel(first.b, radii[0], counts[0], angles[0]),
        Wheel(second.b, radii[1], counts[1], turned, way=-1.0),
    ]


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
    teeth, standing = teeth_on(radius, pitch), teeth_on(abs(ratio) * radius, pitch)
    # at nought of both joints a tooth of the planet points at the wheel that stands, which has a gap there
    out = np.asarray(arm.a.frame) @ np.asarray(arm.b.frame).T @ across
    first = angle_in(planet.a, across) - gear.phase
    gap = angle_in(arm.a, out) + np.pi / standing
    return [
        Wheel(planet.b, radius, teeth, first if ratio > 0.0 else first + np.pi),
        Wheel(arm.a, abs(ratio) * radius, standing, gap, float(np.sign(ratio)), hollow=ratio > 0.0),
    ]


def _apart(a: End, b: End) -> tuple[Array, float]:
    """Return the vector from one shaft to another of the same link, across the first, and its length."""
    across, axis = np.subtract(b.point, a.point), np.asarray(a.axis)
    across = across - axis * (across @ axis)
    return across, float(np.linalg.norm(across))


def _parallel(a: End, b: End) -> bool:
    return float(np.asarray(a.axis) @ np.asarray(b.axis)) > 1.0 - 1e-9
