"""Gears: pairs of meshing toothed wheels, on the frame or on an arm, and racks."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Coupling, End, Gear, Joint
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import ROUNDING, Array
from mechsim.shapes.body import Canvas, rod_radius
from mechsim.shapes.shape import HOUSING, Rgba, pale

WheelKey = tuple[str, float]
# length of the teeth of a bevel gear relative to its slant height
FACE = 0.3


@dataclass(frozen=True, slots=True)
class Cone:
    """The pitch cone of a bevel gear.

    Attributes:
        apex: height of its apex over the joint's point along the axis, in [m].
        height: height of the wheel's back over the apex, in [m].
    """

    apex: float
    height: float


@dataclass(frozen=True, slots=True)
class Wheel:
    """A toothed wheel.

    Attributes:
        end: joint end whose axis is the wheel's.
        radius: radius of the pitch circle, in [m].
        teeth: number of teeth.
        first: angle of a tooth from the joint's reference direction, in [rad].
        direction: +1, or -1 for the wheel of a pair that rotates in the opposite direction about its own
            axis.
        hollow: whether it is a ring with internal teeth.
        cone: pitch cone of a bevel gear.
    """

    end: End
    radius: float
    teeth: int
    first: float
    direction: float = 1.0
    hollow: bool = False
    cone: Cone | None = None

    @property
    def key(self) -> WheelKey:
        """Link and radius to six digits."""
        return self.end.link, float(f"{self.radius:.5e}")


def draw_wheel(canvas: Canvas, wheel: Wheel) -> None:
    """Draw a toothed disc, or a ring with internal teeth, behind all links; a bevel gear in its place.

    A wheel is connected to its link by a hub, a ring by a disc behind its teeth.
    """
    if wheel.cone is not None:
        _bevel(canvas, wheel, wheel.cone)
        return
    end, radius, teeth = wheel.end, wheel.radius, wheel.teeth
    colour, low = wheel_colour(canvas, end.link), wheel_height(canvas) - 0.6 * canvas.r
    depth = 0.7 * np.pi * radius / teeth
    upright = canvas.upright(end)
    centre = np.asarray(end.point) + wheel_height(canvas) * np.asarray(upright.axis)
    inner, outer = radius - 1.3 * depth, radius + 0.8 * depth
    if wheel.hollow:
        inner, outer = radius - 0.8 * depth, radius + 1.3 * depth
        _rim(canvas, end.link, centre, upright, (radius + depth, 0.6 * canvas.r, teeth), colour)
    else:
        canvas.disc(end.link, upright, low, low + 1.2 * canvas.r, radius - depth, colour)
    if end.link != GROUND:
        # the hub that connects a wheel to its link, of a ring with a disc behind its teeth
        if wheel.hollow:
            low -= 0.3 * canvas.r
            canvas.disc(end.link, upright, low, low + 0.6 * canvas.r, radius + depth, colour)
        hub = min(2.9 * canvas.r, 0.7 * (radius + depth))
        canvas.disc(end.link, upright, low, canvas.height(end.link), hub, colour)
    for angle in wheel.first + 2.0 * np.pi * np.arange(teeth) / teeth:
        out = end.frame @ np.array([np.cos(angle), np.sin(angle), 0.0])
        # slightly thinner than the disc, so that coincident faces do not flicker
        tooth = (0.42 * np.pi * radius / teeth, 0.57 * canvas.r)
        canvas.bar(end.link, centre + inner * out, centre + outer * out, tooth, colour, upright.axis)


def wheel_colour(canvas: Canvas, link: str) -> Rgba:
    """Return the colour of the teeth of a link."""
    return pale(canvas.colours[link]) if link in canvas.colours else HOUSING


def wheel_height(canvas: Canvas) -> float:
    """Return the height over a shaft's point at which wheels between parallel shafts mesh, in [m]."""
    return (canvas.back if canvas.normals else -4.5 * canvas.r) + 1.6 * canvas.r


def _bevel(canvas: Canvas, wheel: Wheel, cone: Cone) -> None:
    """Draw a bevel gear: its back, its hub, a shaft to the joint, and teeth that point to the cone's apex."""
    end, colour = wheel.end, wheel_colour(canvas, wheel.end.link)
    axis, point = np.asarray(end.axis), np.asarray(end.point)
    back, front = cone.apex + cone.height, cone.apex + (1.0 - FACE) * cone.height
    depth, rear = 0.7 * np.pi * wheel.radius / wheel.teeth, back + np.copysign(0.8 * canvas.r, cone.height)
    root = wheel.radius - depth
    discs = (back, rear, root), (front, back, (1.0 - FACE) * root), (0.0, rear, canvas.r)
    for low, high, radius in discs:
        canvas.disc(end.link, end, min(low, high), max(low, high), radius, colour)
    slant = float(np.hypot(wheel.radius, cone.height))
    for angle in wheel.first + 2.0 * np.pi * np.arange(wheel.teeth) / wheel.teeth:
        out = end.frame @ np.array([np.cos(angle), np.sin(angle), 0.0])
        heel = cone.height * axis + wheel.radius * out
        across = (wheel.radius * axis - cone.height * out) / slant
        tip = point + cone.apex * axis
        tooth = (0.42 * np.pi * (1.0 - 0.5 * FACE) * wheel.radius / wheel.teeth, depth)
        canvas.bar(end.link, tip + (1.0 - FACE) * heel, tip + heel, tooth, colour, across)


def _rim(
    canvas: Canvas, link: str, centre: Array, end: End, sizes: tuple[float, float, int], colour: Rgba
) -> None:
    """Draw a ring of bars: inner radius, half thickness, number of bars."""
    inner, thick, bars = sizes
    half = 1.2 * canvas.r
    for angle in 2.0 * np.pi * np.arange(bars) / bars:
        c, s = np.cos(angle), np.sin(angle)
        out, along = end.frame @ np.array([c, s, 0.0]), end.frame @ np.array([-s, c, 0.0])
        # the length at which the outer corners of bars meet
        reach = (inner + 2.0 * half) * np.tan(np.pi / bars)
        middle = centre + (inner + half) * out
        canvas.bar(link, middle - reach * along, middle + reach * along, (half, thick), colour, end.axis)


def teeth_on(radius: float, pitch: float) -> int:
    """Return the number of teeth of a wheel if a tooth takes `pitch` of its radius."""
    return max(1, round(radius / pitch))


def angle_in(end: End, direction: Array) -> float:
    """Return the angle of a direction about a joint's axis, from its reference direction."""
    x, y, _ = end.frame.T @ direction
    return float(np.arctan2(y, x))


# number of teeth of the smallest wheel
MIN_TEETH = 18


def draw_gears(canvas: Canvas) -> None:
    """Draw the wheels of all gears with parallel or intersecting shafts, each wheel once, and all racks."""
    mechanism, drawn = canvas.mechanism, dict[WheelKey, Wheel]()
    pitch = _pitch([wheel.radius for gear in mechanism.gears for wheel in wheels_of(mechanism, gear)])
    for gear in mechanism.gears:
        for wheel in _meshing(wheels_of(mechanism, gear, pitch), drawn):
            if wheel.key not in drawn:
                drawn[wheel.key] = wheel
                draw_wheel(canvas, wheel)
    for coupling, rack, pinion in racks_of(mechanism):
        _draw_rack(canvas, coupling, rack, pinion)


def _pitch(radii: Sequence[float]) -> float:
    """Return the radius per tooth with which all wheels have nearly integer numbers of teeth."""
    if not radii:
        return 1.0
    counts = np.arange(MIN_TEETH, 3 * MIN_TEETH)
    teeth = np.outer(counts, radii) / min(radii)
    off = np.abs(teeth - np.round(teeth)).max(1).round(6)
    return min(radii) / float(counts[np.argmin(off)])


def _meshing(pair: Sequence[Wheel], drawn: Mapping[WheelKey, Wheel]) -> Sequence[Wheel]:
    """Return a pair rotated so that the wheel that is already drawn keeps its teeth."""
    for wheel, other in (pair, pair[::-1]) if pair else ():
        if wheel.key in drawn:
            off = (drawn[wheel.key].first - wheel.first) * wheel.teeth / other.teeth
            return [replace(other, first=other.first + wheel.direction * other.direction * off)]
    return pair


def wheels_of(mechanism: Mechanism, gear: Gear, pitch: float = 1.0) -> list[Wheel]:
    """Return both wheels of a gear; none if the shafts are skew or the ratio does not fit wheels.

    A tooth takes `pitch` of a radius, in [m].
    """
    first, second = mechanism.joint(gear.driver), mechanism.joint(gear.driven)
    if first.a.link == second.a.link:
        wheels = _side_by_side(first, second, gear, pitch)
        rates, ends = (1.0, gear.ratio), (first.a, first.b)
    elif first.b.link == second.a.link:
        wheels = _on_an_arm(first, second, gear, pitch)
        rates, ends = (-1.0, gear.ratio), (first.b, first.a)
    else:
        return []
    if wheels or not rates[1]:
        return wheels
    return bevel_pair(ends, (second.a, second.b), rates, gear.phase, rod_radius(mechanism), pitch)


def _side_by_side(first: Joint, second: Joint, gear: Gear, pitch: float) -> list[Wheel]:
    """Return two externally meshing wheels whose shafts are on the same link."""
    across, distance = _apart(first.a, second.a)
    if not (_parallel(first.a, second.a) and gear.ratio < 0.0 and distance > 0.0):
        return []
    fast = 1.0 / (1.0 + abs(gear.ratio))  # radius of the driven gear relative to the distance
    radii = distance * (1.0 - fast), distance * fast
    angles = [angle_in(joint.a, sign * across) for joint, sign in ((first, 1.0), (second, -1.0))]
    # at driver angle zero a gap of the driven gear faces a tooth of the driver
    counts = [teeth_on(radius, pitch) for radius in radii]
    second_angle = angles[1] - gear.phase + np.pi / counts[1]
    return [
        Wheel(first.b, radii[0], counts[0], angles[0]),
        Wheel(second.b, radii[1], counts[1], second_angle, direction=-1.0),
    ]


def _on_an_arm(arm: Joint, planet: Joint, gear: Gear, pitch: float) -> list[Wheel]:
    """Return a planet on the arm that drives it, and the fixed wheel on the arm's shaft.

    Relative to the arm, that wheel rotates backward by the arm's angle. Inside a ring the planet also rotates
    backward, and so does a ring around a fixed wheel; around a wheel a planet rotates forward.
    """
    across, distance = _apart(arm.b, planet.a)
    ratio = -gear.ratio if _parallel(arm.b, planet.a) else 0.0
    radius_ratio = abs(ratio - 1.0)
    if not (ratio and radius_ratio > 0.0 and distance > 0.0):
        return []
    radius = distance / radius_ratio
    teeth, standing = teeth_on(radius, pitch), teeth_on(abs(ratio) * radius, pitch)
    # at zero of both joints a tooth of the planet points at the fixed wheel, which has a gap there
    ring = 0.0 < ratio < 1.0
    out = np.asarray(arm.a.frame) @ np.asarray(arm.b.frame).T @ (-across if ring else across)
    first = angle_in(planet.a, across) - gear.phase
    gap = angle_in(arm.a, out) + np.pi / standing
    return [
        Wheel(planet.b, radius, teeth, first if ratio > 1.0 else first + np.pi, hollow=ring),
        Wheel(arm.a, abs(ratio) * radius, standing, gap, float(np.sign(ratio)), hollow=ratio > 1.0),
    ]


def _apart(a: End, b: End) -> tuple[Array, float]:
    """Return the vector between two shafts of the same link, perpendicular to the first, and its length."""
    across, axis = np.subtract(b.point, a.point), np.asarray(a.axis)
    across = across - axis * (across @ axis)
    return across, float(np.linalg.norm(across))


def _parallel(a: End, b: End) -> bool:
    return float(np.dot(a.axis, b.axis)) > 1.0 - 1e-9


# distance of two axes relative to a rod's radius below which they intersect
MAX_AXIS_DISTANCE = 1e-3
# sine of the angle between axes below which they are parallel
PARALLEL = 1e-6
# slant height of wheels whose joints both lie at the intersection of the shafts, in radii of rods
SLANT = 9.0
Ends = tuple[End, End]


def bevel_pair(
    first: Ends, second: Ends, rates: tuple[float, float], phase: float, rod: float, pitch: float
) -> list[Wheel]:
    """Return two wheels with intersecting shafts; none if these are parallel or skew.

    Relative to the link that carries both, wheels with rates w1 and w2 about axes u1 and u2 roll on each
    other along the direction of w1 u1 - w2 u2. The wheels lie near their joints, if possible.

    Args:
        first: ends of the first wheel's joint: on the link that carries both, and on the wheel.
        second: those of the second wheel's joint.
        rates: rates of both wheels about their axes, relative to that link.
        phase: angle of the second joint at zero of the first, in [rad].
        rod: radius of rods in [m].
        pitch: radius per tooth, in [m].
    """
    carriers, own = zip(first, second, strict=True)
    apex = _axes_intersection(*carriers, MAX_AXIS_DISTANCE * rod)
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
    # at zero of the first joint a tooth of its wheel faces a gap of the other
    starts = angles[0], angles[1] - phase + np.pi / counts[1]
    ways = 1.0, float(np.sign(rates[0] * rates[1]))
    return [
        Wheel(
            own[i],
            slant * float(sines[i]),
            counts[i],
            starts[i],
            ways[i],
            cone=Cone(float(tips[i]), slant * float(cosines[i])),
        )
        for i in range(2)
    ]


def _side(along: Array, cosines: Array, heights: Array, least: float) -> tuple[Array, Array, float]:
    """Return the line of contact on the side of the joints, its cosines, and its length in [m].

    Heights are those of the joints over the intersection of the shafts; a flat wheel can lie anywhere.
    """
    conical = np.abs(cosines) > PARALLEL
    slants = np.divide(heights, cosines, out=np.zeros(2), where=conical)
    farther, nearer = sorted(slants.tolist(), key=abs, reverse=True)
    nearest = nearer if farther * nearer > 0.0 else farther
    if abs(nearest) < least:
        nearest = least if nearest >= 0.0 else -least
    sign = float(np.sign(nearest))
    return sign * along, sign * cosines, abs(nearest)


def _axes_intersection(a: End, b: End, max_distance: float) -> Array | None:
    """Return the intersection of two joint axes, (3,); None if they are parallel or farther apart."""
    across = np.cross(a.axis, b.axis)
    square = float(across @ across)
    if not square > PARALLEL**2:
        return None
    off = np.subtract(b.point, a.point)
    if abs(float(off @ across)) > max_distance * square**0.5:
        return None
    return a.point + np.asarray(a.axis) * float(np.cross(off, b.axis) @ across / square)


# largest number of teeth of a rack that is drawn
MAX_RACK_TEETH = 400


def racks_of(mechanism: Mechanism) -> Iterator[tuple[Coupling, Joint, Joint]]:
    """Yield the couplings of a rack with a pinion, and the joints of both; the pitch radius is the ratio."""
    joints = {joint.name: joint for joint in mechanism.joints}
    for coupling in mechanism.couplings:
        if isinstance(coupling.left, str) and isinstance(coupling.right, str):
            rack, pinion = joints.get(coupling.left), joints.get(coupling.right)
            if not rack or not pinion or rack.a.link != pinion.a.link:
                continue
            slide, hinge = KINDS[rack.kind], KINDS[pinion.kind]
            square = abs(float(np.dot(rack.a.axis, pinion.a.axis))) < ROUNDING
            linear = len(coupling.coefficients) == 2 and coupling.ratio != 0.0
            if slide.single and not slide.turns and hinge.hinge and square and linear:
                yield coupling, rack, pinion


def _draw_rack(canvas: Canvas, coupling: Coupling, rack: Joint, pinion: Joint) -> None:
    """Draw a pinion and its rack as long as its travel, with a tooth of one in a gap of the other.

    A bracket connects the rack to its slide.
    """
    radius, teeth = abs(coupling.ratio), MIN_TEETH
    step = 2.0 * np.pi * radius / teeth
    slide_axis, axis = np.asarray(rack.a.axis), np.asarray(pinion.a.axis)
    out = np.cross(slide_axis, axis) * np.sign(coupling.ratio)
    draw_wheel(canvas, Wheel(pinion.b, radius, teeth, angle_in(pinion.a, out) - coupling.zeros[1]))
    own = pinion.a
    up = np.asarray(canvas.upright(own).axis)
    meet = own.point + wheel_height(canvas) * up + radius * out
    # in the rack's frame, which moves along the slide
    rotation = rack.b.frame @ rack.a.frame.T
    zero = coupling.zeros[0] + coupling.coefficients[0]
    base = rack.b.point + rotation @ (meet - rack.a.point) - zero * (rotation @ slide_axis)
    low, high = (zero - end for end in canvas.travel_of(rack)[::-1])
    depth, colour = 0.7 * np.pi * radius / teeth, wheel_colour(canvas, rack.b.link)
    outward, forward, flat = rotation @ out, rotation @ slide_axis, rotation @ axis
    first, last = np.floor(low / step) - 2.0, np.ceil(high / step) + 2.0
    if last - first > MAX_RACK_TEETH:
        return
    link, tooth = rack.b.link, (0.21 * step, 0.57 * canvas.r)
    for k in np.arange(first, last) + 0.5:
        foot = base + k * step * forward
        canvas.bar(link, foot - 0.8 * depth * outward, foot + 1.3 * depth * outward, tooth, colour, flat)
    bar, sizes = base + (depth + 1.2 * canvas.r) * outward, (1.2 * canvas.r, 0.6 * canvas.r)
    canvas.bar(link, bar + first * step * forward, bar + last * step * forward, sizes, colour, flat)
    if rack.b.link != GROUND:
        own = rack.b.point + canvas.lift(rack.b)
        along = np.clip(float((own - bar) @ forward), first * step, last * step)
        under = bar + along * forward
        canvas.join(link, (own, under + float((own - under) @ flat) * flat, under))
