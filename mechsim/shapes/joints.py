"""Shapes of each kind of joint: eyes and pins, shafts in bearings, blocks on rails, balls, crosses."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np

from mechsim.mechanism.forces import Forces
from mechsim.mechanism.joint_kinds import KindName
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, Link
from mechsim.mechanism.links import IDENTITY as GROUND_POSE
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.moved_links import with_rods
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.shapes.body import Canvas, edges, fixed_links, free_sides, hull, span, stations
from mechsim.shapes.gears import draw_gears
from mechsim.shapes.guides import draw_contacts, hidden_links
from mechsim.shapes.shape import HOUSING, RUBBER, STEEL, Rgba, Shape, plate_of
from mechsim.shapes.springs import spring_ends, torsion_springs


def revolute(canvas: Canvas, joint: Joint) -> None:
    """Draw eyes and a pin in a planar mechanism, else a shaft in a bearing or a fork."""
    (flat_revolute if canvas.normals else spatial_revolute)(canvas, joint)


def flat_revolute(canvas: Canvas, joint: Joint) -> None:
    """Draw two eyes in their layers and a pin through both; on the ground a boss on the plate."""
    assert canvas.normals
    moving = [end for end in (joint.a, joint.b) if end.link != GROUND]
    heights = [canvas.height(end.link) for end in moving]
    r, thick, top = canvas.r, 0.62 * canvas.r, max(heights) + 1.0 * canvas.r
    for end, height in zip(moving, heights, strict=True):
        colour = canvas.colours[end.link]
        canvas.disc(end.link, canvas.upright(end), height - thick, height + thick, 1.9 * r, colour)
    pin, bottom = joint.b if joint.b.link == GROUND else joint.a, min(heights) - 1.0 * r
    if pin.link == GROUND:
        bottom = canvas.back
        canvas.disc(GROUND, canvas.upright(pin), bottom, min(heights) - 1.2 * thick, 2.4 * r, HOUSING)
    canvas.disc(pin.link, canvas.upright(pin), bottom, top, 0.9 * r, STEEL)


def spatial_revolute(canvas: Canvas, joint: Joint) -> None:
    """Draw a hub and a shaft into a bearing on the ground; between moving links a fork and an eye."""
    r = canvas.r
    for ground, link in ((joint.a, joint.b), (joint.b, joint.a)):
        if ground.link == GROUND:
            canvas.disc(link.link, link, -1.6 * r, 1.6 * r, 2.0 * r, canvas.colours[link.link])
            canvas.shaft(joint, ground)
            return
    a, b = joint.a, joint.b
    canvas.disc(b.link, b, -1.1 * r, 1.1 * r, 1.9 * r, canvas.colours[b.link])
    for low, high in ((-2.0 * r, -1.2 * r), (1.2 * r, 2.0 * r)):
        canvas.disc(a.link, a, low, high, 1.9 * r, canvas.colours[a.link])
    canvas.disc(a.link, a, -2.5 * r, 2.5 * r, 0.9 * r, STEEL)


def ball(canvas: Canvas, joint: Joint) -> None:
    """Draw a steel ball on the ground, else on the first link, and a collar of the other link around it."""
    inner, around = (joint.b, joint.a) if joint.b.link == GROUND else (joint.a, joint.b)
    canvas.add(inner.link, "sphere", inner.point, inner.point, 2.0 * canvas.r, STEEL)
    canvas.carry(inner.link)
    # the direction from a joint to the rest of its link
    rest = np.array(stations(canvas.mechanism, around.link)) - np.asarray(around.point)
    towards = rest.sum(0)
    length = float(np.linalg.norm(towards))
    if length > 0.1 * canvas.r:
        centre, rod = np.asarray(around.point), towards / length
        ends = centre + 1.0 * canvas.r * rod, centre + 2.6 * canvas.r * rod
        canvas.add(around.link, "cylinder", *ends, 1.8 * canvas.r, canvas.colours[around.link])


def cross(canvas: Canvas, joint: Joint) -> None:
    """Draw the two crossing pins of a universal joint, each on its own link; on the ground a shaft."""
    r = canvas.r
    canvas.disc(joint.a.link, joint.a, -2.8 * r, 2.8 * r, 1.0 * r, STEEL)
    canvas.disc(joint.b.link, joint.b, -2.4 * r, 2.4 * r, 1.3 * r, canvas.colours.get(joint.b.link, STEEL))
    canvas.add(joint.a.link, "sphere", joint.a.point, joint.a.point, 1.6 * r, STEEL)
    for end in (joint.a, joint.b):
        if end.link == GROUND:
            canvas.shaft(joint, end)


def slide(canvas: Canvas, joint: Joint) -> None:
    """Draw a block on a rail as long as its travel; on a moving link the rail ends with the link."""
    r = canvas.r
    low, high = _reach(canvas, joint, 4.0 * r)
    rail, block = joint.a, joint.b
    thick, axis = canvas.thickness(rail), np.asarray(rail.axis)
    own = np.asarray(rail.point) + canvas.lift(rail)
    middle = own - 1.9 * r * thick
    colour = canvas.colours.get(rail.link, STEEL)
    canvas.bar(rail.link, middle + low * axis, middle + high * axis, (1.4 * r, 0.6 * r), colour, thick)
    if rail.link == GROUND:
        _feet(canvas, thick)
    else:
        canvas.add(rail.link, "cylinder", own, middle, r, colour)
    thick, half = canvas.thickness(block), 3.0 * r * np.asarray(block.axis)
    middle, colour = np.asarray(block.point) + canvas.lift(block), canvas.colours.get(block.link, STEEL)
    canvas.bar(block.link, middle - half, middle + half, (2.2 * r, 1.2 * r), colour, thick)
    if block.link == GROUND:
        _feet(canvas, thick)


def sleeve(canvas: Canvas, joint: Joint) -> None:
    """Draw a shaft on one link, as long as its travel, and a sleeve on the other."""
    r = canvas.r
    low, high = _reach(canvas, joint, 8.0 * r)
    canvas.disc(joint.a.link, joint.a, low, high, 1.0 * r, canvas.colours.get(joint.a.link, STEEL))
    if joint.a.link == GROUND:
        for low_end in (low, high - 2.4 * r):
            canvas.bearing(joint.a, low_end, low_end + 2.4 * r)
    canvas.disc(joint.b.link, joint.b, -3.0 * r, 3.0 * r, 1.9 * r, canvas.colours.get(joint.b.link, HOUSING))
    canvas.carry(joint.b.link)


def plate(canvas: Canvas, joint: Joint) -> None:
    """Draw a table across the axis on one link, as wide as its travel, and a foot on it."""
    r = canvas.r
    table, foot, (table_height, foot_height) = _joint_ends(canvas, joint)
    radius = canvas.travel_of(joint)[1] + 3.0 * r
    # a ground wider than the mechanism is its backdrop
    if table.link != GROUND or radius < 0.5 * span(canvas.mechanism):
        low, colour = table_height - 0.6 * r, canvas.colours.get(table.link, STEEL)
        canvas.disc(table.link, table, low, table_height, radius, colour)
        canvas.carry(table.link)
    low, high = sorted((table_height, foot_height))
    canvas.disc(foot.link, foot, low, high + 1.2 * r, 2.0 * r, canvas.colours.get(foot.link, HOUSING))
    canvas.carry(foot.link)


def weld(canvas: Canvas, joint: Joint) -> None:
    """Draw a collar at a fixed joint."""
    a, b, heights = _joint_ends(canvas, joint)
    r, end = canvas.r, b if a.link != GROUND else a
    canvas.disc(end.link, end, min(heights) - 0.8 * r, max(heights) + 0.8 * r, 1.6 * r, HOUSING)
    canvas.carry(end.link)


def _joint_ends(canvas: Canvas, joint: Joint) -> tuple[End, End, tuple[float, float]]:
    """Return both ends of a joint, with axes along the normal in a planar mechanism, and their heights."""
    heights = (canvas.level(joint.a.link), canvas.level(joint.b.link)) if canvas.normals else (0.0, 0.0)
    return canvas.upright(joint.a), canvas.upright(joint.b), heights


def _reach(canvas: Canvas, joint: Joint, clearance: float) -> tuple[float, float]:
    """Return both ends of a guide along its axis: the travel with a margin, extended to its link."""
    low, high = canvas.travel_of(joint)
    low, high = low - clearance, high + clearance
    return (low, high) if joint.a.link == GROUND else (min(low, -canvas.r), max(high, canvas.r))


def _feet(canvas: Canvas, thick: Array) -> None:
    """Draw two feet of the rail or block drawn last: on the mounting plate, or clamps for posts."""
    r, guide = canvas.r, canvas.out[GROUND][-1]
    for end, inward in ((guide.frm, guide.to), (guide.to, guide.frm)):
        along = np.subtract(inward, end)
        along = 2.0 * r * along / np.linalg.norm(along)
        foot = np.asarray(end) + along
        if canvas.normals:
            plate = foot + thick * (canvas.back - float(foot @ thick))
            canvas.add(GROUND, "cylinder", foot, plate, 1.3 * r, HOUSING)
        else:
            sizes = (guide.sizes[0] + 0.4 * r, r)
            canvas.bar(GROUND, foot - 0.6 * along, foot + 0.6 * along, sizes, HOUSING, thick)
            canvas.carry()


# turns and chords of a spring in a revolute joint
SPIRAL_TURNS, SPIRAL_CHORDS = 2.5, 50
# radius of the disc between slides, in rod radii
DISC = 9.0
# how joints look; a distance is drawn as a link between two balls, and of others nothing is seen
DRAW: dict[KindName, Callable[[Canvas, Joint], None]] = {
    "revolute": revolute,
    "prismatic": slide,
    "cylindrical": sleeve,
    "screw": sleeve,
    "planar": plate,
    "fixed": weld,
    "point_on_line": sleeve,
    "point_on_plane": plate,
    "universal": cross,
    "spherical": ball,
}


def link_shapes(
    mechanism: Mechanism,
    travel: Mapping[str, tuple[float, float]] | None = None,
    outward: Mapping[str, float] | None = None,
    forces: Forces | None = None,
    radius: float | None = None,
) -> dict[str, list[Shape]]:
    """Return the shapes of every link, "ground" included.

    Args:
        mechanism: the mechanism.
        travel: joint -> smallest and largest displacement along its axis in [m], if known from a motion;
            other sliding joints get rails long enough for any motion from the guess.
        outward: joint -> direction along its axis from which its shaft extends to a bearing, +1 or -1; see
            `free_sides`. The default is the side that is free in the guess.
        forces: whose springs and bushings are drawn on the links.
        radius: of rods in [m]; the default is that for the mechanism's size.
    """
    mechanism = with_rods(mechanism, {})[0]
    if outward is None:
        outward = free_sides(mechanism, {GROUND: GROUND_POSE, **mechanism.guess})
    canvas = Canvas(mechanism, dict(travel or {}), dict(outward), radius)
    hidden = hidden_links(mechanism)
    links = [link for link in mechanism.links if link.name not in hidden]
    bodies, joined = [link.name for link in links], dict[str, list[Joint]]()
    for joint in mechanism.joints:
        for name in {*joint.links}:
            joined.setdefault(name, []).append(joint)
    for link in links:
        _body(canvas, link, joined.get(link.name, []), hidden)
    for joint in mechanism.joints:
        if joint.kind in DRAW and {*joint.links} <= {GROUND, *bodies}:
            DRAW[joint.kind](canvas, joint)
    for name in torsion_springs(mechanism, forces):
        draw_torsion_spring(canvas, mechanism.joint(name))
    draw_mounts(canvas, forces)
    draw_gears(canvas)
    if any(coupling.belt or coupling.rope for coupling in mechanism.couplings):
        from mechsim.shapes.belts import draw_belts, draw_ropes

        draw_belts(canvas)
        draw_ropes(canvas)
    draw_contacts(canvas)
    return canvas.out


def _polygon(canvas: Canvas, link: Link) -> Iterator[tuple[Array, Array]]:
    """Draw a polygon as a plate, and yield rods to joints outside; the sides of one fixed to the frame."""
    corners, lift = np.array(link.outline), canvas.lift_of(link.name)
    if link.name in fixed_links(canvas.mechanism):
        yield from pairwise([*corners, corners[0]])
        return
    axes = np.linalg.svd(corners - corners.mean(0), full_matrices=False)[2]
    face = plate_of(corners + lift, 0.5 * canvas.r * axes[2], canvas.colours[link.name])
    canvas.out[link.name].append(face)
    for end in canvas.mechanism.ends(link.name):
        off = (corners - end.point) @ axes[:2].T @ [1.0, 1j]
        # the angle that the polygon turns about the joint: 0 outside
        if abs(np.angle(np.roll(off, -1) * off.conj()).sum()) < 1.0:
            yield np.asarray(end.point), corners[np.argmin(np.abs(off))]


def _platform(points: Array, radius: float, colour: Rgba) -> list[Shape]:
    """Return the plate of a link whose joints and other points, (n, 3), lie in a plane; none for others."""
    middle = points.mean(0)
    _, spread, axes = np.linalg.svd(points - middle, full_matrices=False)
    if len(points) < 3 or not spread[1] > radius > spread[2]:
        return []
    edge = points[hull((points - middle) @ axes[:2].T)]
    return [plate_of(edge, 0.6 * radius * axes[2], colour)]


def _body(canvas: Canvas, row: Link, joints: Sequence[Joint], hidden: set[str]) -> None:
    """Draw rods between the points of a link with its joints, and an eye where there is no joint.

    A link of slides through one point, such as that of an Oldham coupling, is a disc.
    """
    link = row.name
    positions, colour, lift = stations(canvas.mechanism, link), canvas.colours[link], canvas.lift_of(link)
    own = [joint for joint in joints if not hidden.intersection(joint.links)]
    bars = edges(positions)
    if row.polygon:
        bars = _polygon(canvas, row)
    elif not canvas.normals and len(own) > 2:
        canvas.out[link].extend(_platform(np.array(positions), canvas.r, colour))
    for i, (a, b) in enumerate(bars):
        if canvas.normals:
            # where faces coincide, a renderer adds the light of all: no two rods that meet are as thick
            sizes = 1.15 * canvas.r, (0.5 - 0.01 * (i % 8)) * canvas.r
            canvas.bar(link, a + lift, b + lift, sizes, colour, canvas.normals[link])
        else:
            canvas.add(link, "capsule", a, b, canvas.r, colour)
    if canvas.normals and len(positions) == 1 and len(own) > 1 and {j.kind for j in own} == {"prismatic"}:
        end, half = canvas.upright(canvas.mechanism.ends(link)[0]), 0.5 * canvas.r
        middle, glass = canvas.height(link), (*colour[:3], 0.5)
        canvas.disc(link, end, middle - half, middle + half, DISC * canvas.r, glass)
    joint_points = [np.asarray(end.point) for end in canvas.mechanism.ends(link)]
    for position in positions:
        if min(float(np.linalg.norm(position - joint)) for joint in joint_points) > 0.1 * canvas.r:
            canvas.add(link, "sphere", position + lift, position + lift, 1.5 * canvas.r, colour)


def draw_torsion_spring(canvas: Canvas, joint: Joint) -> None:
    """Draw a spiral over a joint, from its pin to the second link."""
    end = joint.b if joint.b.link != GROUND else joint.a
    upright = canvas.upright(end)
    heights = [canvas.height(link) for link in joint.links if link != GROUND]
    axis, side = np.asarray(upright.axis), end.frame[:, 0]
    angle = np.linspace(0.0, SPIRAL_TURNS * REVOLUTION, SPIRAL_CHORDS + 1)[:, None]
    out = np.cos(angle) * side + np.sin(angle) * np.cross(axis, side)
    radius = canvas.r * (1.0 + 4.0 * angle / angle[-1])
    points = np.asarray(end.point) + (max(heights) + 1.6 * canvas.r) * axis + radius * out
    for frm, to in pairwise(points):
        canvas.add(end.link, "capsule", frm, to, 0.35 * canvas.r, STEEL)


def draw_mounts(canvas: Canvas, forces: Forces | None) -> None:
    """Draw a ball where a spring ends on the frame, and a bushing as a ring with its core on side b.

    With the ball the end of the spring is seen and lies within the picture.
    """
    for a, b, _ in spring_ends(canvas.mechanism, forces):
        for link, point in (a, b):
            if link == GROUND:
                canvas.add(link, "sphere", point, point, 1.2 * canvas.r, HOUSING)
    for bushing in () if forces is None else forces.bushings:
        for end, length, radius, colour in ((bushing.a, 0.8, 2.2, RUBBER), (bushing.b, 1.2, 1.1, STEEL)):
            half = length * canvas.r * np.asarray(end.axis)
            canvas.add(end.link, "cylinder", end.point - half, end.point + half, radius * canvas.r, colour)
