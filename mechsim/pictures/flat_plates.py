"""Links as flat plates with their holes, as drawings in DXF and SVG at the scale 1:1 in millimetres.

A link is flat if the axes of its hinges are parallel: the holes are where these pierce the plane across them,
so that the distance of two holes is that of the axes. Its outline keeps a distance from all holes and points.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.cams import Cam
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, Link
from mechsim.mechanism.masses import RELATIVE_DIAMETER
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array, distinct
from mechsim.shapes.body import hull
from mechsim.shapes.guides import contact_points

MILLIMETRES = 1e3  # in a metre
# from the centre of a hole to the edge, in diameters; EN 1993-1-8, table 3.3 asks for 1.2 at least
EDGE = 1.5
# chords of the profile of a cam: a quarter of a degree, 2.4e-6 of the radius from the arc
CHORDS = 1440
# sine of the angle between axes that count as parallel, and height relative to the length (rounding)
PARALLEL = 1e-9
# layer of what is not cut: names, tracked points, directions of slides, curves
CONSTRUCTION = "construction"


@dataclass(frozen=True)
class Plate:
    """A flat plate, in [mm].

    Attributes:
        name: of the link or cam.
        outlines: closed lines, each (n, 3): vertices x, y, and the bulge of the edge to the next vertex, the
            tangent of a quarter of the angle of its arc; 0 for a straight edge.
        holes: centres of the holes, (k, 2).
        construction: straight lines that are not cut, x, y of both ends, (m, 4).
        hole: diameter of the holes.
    """

    name: str
    outlines: tuple[Array, ...]
    holes: Array
    construction: Array
    hole: float

    def moved(self, shift: Array) -> "Plate":
        """Return the plate moved by a shift, (2,)."""
        outlines = tuple(outline + np.append(shift, 0.0) for outline in self.outlines)
        lines = self.construction + np.tile(shift, 2)
        return replace(self, outlines=outlines, holes=self.holes + shift, construction=lines)

    @property
    def box(self) -> Array:
        """Lowest and highest x and y, with the edge distance around all vertices, (2, 2)."""
        outlines = (outline[:, :2] for outline in self.outlines)
        vertices = np.vstack([*outlines, self.construction.reshape(-1, 2)])
        edge = EDGE * self.hole
        return np.array([vertices.min(0) - edge, vertices.max(0) + edge])


def cross(point: Array, length: float) -> Array:
    """Return the two lines that mark a point, (2, 4)."""
    arms = 0.5 * length * np.eye(2)
    return np.hstack([point - arms, point + arms])


def closed_line(points: Array) -> Array:
    """Return the outline with straight edges between points (n, 2)."""
    return np.column_stack([points, np.zeros(len(points))])


def flat_plates(mechanism: Mechanism, hole: float | None = None) -> tuple[list[Plate], str]:
    """Return the ground and the links as flat plates in a row, and a sentence on those that are not flat.

    Args:
        mechanism: its links and joints.
        hole: diameter of the holes in [m]; by default that of the rods from which masses are computed.

    Raises:
        InputError: for a diameter that is not above 0, or if no link is flat.
    """
    diameter = RELATIVE_DIAMETER * mechanism.characteristic_length if hole is None else hole
    if not 0.0 < diameter < np.inf:
        raise InputError(f"the diameter of holes is {diameter:g} m; give a finite length above 0")
    plates, others = list[Plate](), list[str]()
    for link in (Link(GROUND), *(link for link in mechanism.links if link.is_body)):
        plate = _flat_plate(mechanism, link, MILLIMETRES * diameter)
        if plate is None:
            others.append(link.name)
            continue
        start = plates[-1].box[1, 0] + plates[-1].hole if plates else 0.0
        plates.append(plate.moved(np.array([start, 0.0]) - plate.box[0]))
    reason = f"no flat plates, their axes or the points on them are in no common plane: {', '.join(others)}"
    if not plates:
        raise InputError(f"{mechanism.name}: {reason}; export TOML or MJCF instead")
    return plates, reason if others else ""


def _flat_plate(mechanism: Mechanism, link: Link, hole: float) -> Plate | None:
    """Return a link as a flat plate; None if it is not flat."""
    joined = [
        (joint, end)
        for joint in mechanism.written_joints
        for end in (joint.a, joint.b)
        if end.link == link.name and not KINDS[joint.kind].floating
    ]
    tracked = [point for owner, point in mechanism.points.values() if owner == link.name]
    length = mechanism.characteristic_length
    normal = _normal(mechanism, joined, length)
    every = np.array([*(end.point for _, end in joined), *tracked, *link.outline]).reshape(-1, 3)
    if normal is None or not len(every):
        return None
    slides = [end for joint, end in joined if _slides_across(joint, end, normal)]
    curved = [name for name, contact in mechanism.contacts.items() if contact.carrier == link.name]
    bored = [
        np.array(end.point)
        for joint, end in joined
        if end not in slides and KINDS[joint.kind].turns and not (joint.name in curved and end is joint.a)
    ]
    spread = [point - every[0] for point in (*bored, *every)] + [np.array(end.axis) for end in slides]
    axes, gap = MILLIMETRES * _plane(normal, spread, PARALLEL * length), MILLIMETRES * PARALLEL * length

    def flat(points: Any) -> Array:
        return (np.array(points).reshape(-1, 3) - every[0]) @ axes.T

    centres = np.reshape(distinct(flat(bored), gap), (-1, 2))
    construction = [cross(point, hole) for point in flat(tracked)]
    for end in slides:
        (middle,), along = flat(end.point), 2.0 * hole * (axes @ np.array(end.axis)) / MILLIMETRES
        construction.append(np.array([[*middle - along, *middle + along]]))
    outlines: list[Array] = []
    for name in curved:
        contact = mechanism.contacts[name]
        points = flat(contact_points(mechanism.joint(name).a, contact, CHORDS))
        if isinstance(contact.shape, Cam):
            outlines.append(closed_line(points[:-1]))
        else:
            construction += [np.array([[*start, *end]]) for start, end in pairwise(points)]
    if link.polygon:
        outlines.append(closed_line(flat(link.outline)))
    return Plate(
        link.name,
        tuple(outlines) or (_rounded(np.array(distinct(flat(every), gap)), EDGE * hole),),
        centres,
        np.vstack([np.zeros((0, 4)), *construction]),
        hole,
    )


def _normal(mechanism: Mechanism, joined: Sequence[tuple[Joint, End]], length: float) -> Array | None:
    """Return the direction across a link, parallel to its hinges; None if it is not flat."""
    # side b of a joint on a cam is the roller or the face, without an axis
    hinged = [
        end
        for joint, end in joined
        if KINDS[joint.kind].turns == ("a",) and (joint.name not in mechanism.contacts or end is joint.a)
    ]
    slides = [np.array(end.axis) for joint, end in joined if not KINDS[joint.kind].turns]
    # the height of a hinge or slide is free
    balls = [end for joint, end in joined if end not in hinged and (KINDS[joint.kind].turns or not hinged)]
    points = np.array([end.point for end in balls]).reshape(-1, 3)
    across = (points - points[:1]) / length
    if hinged:
        normal = np.array(hinged[0].axis)
        aligned = all(np.linalg.norm(np.cross(normal, end.axis)) <= PARALLEL for end in hinged)
        level = bool((np.abs(across @ normal) <= PARALLEL).all())
        square = all(min(abs(axis @ normal), 1.0 - abs(axis @ normal)) <= PARALLEL for axis in slides)
        fits = aligned and level and square
    else:
        _, sizes, directions = np.linalg.svd(np.vstack([across, *slides, np.zeros((3, 3))]))
        normal, fits = directions[2], bool(sizes[2] <= PARALLEL)
    upwards = 1.0 if normal[np.argmax(np.abs(normal) > 0.5)] > 0.0 else -1.0
    return upwards * normal if fits else None


def _slides_across(joint: Joint, end: End, normal: Array) -> bool:
    """Return whether a joint slides in the plane of the plate, along a line that is fixed on it."""
    kind = KINDS[joint.kind]
    fixed = kind.slides == ("a",) and (not kind.turns or end is joint.a)
    return fixed and abs(float(np.array(end.axis) @ normal)) < 0.5


def _plane(normal: Array, spread: Sequence[Array], tolerance: float) -> Array:
    """Return the axes of a plane, (2, 3): x along the first of several vectors that is not across it."""
    flat = [vector - normal * (vector @ normal) for vector in spread]
    x = next((v for v in flat if np.linalg.norm(v) > tolerance), np.linalg.svd(normal[None])[2][1])
    x = x / np.linalg.norm(x)
    return np.array([x, np.cross(normal, x)])


def _rounded(points: Array, distance: float) -> Array:
    """Return the outline at a distance from the convex hull of points, with arcs about its corners."""
    if len(points) == 1:
        return np.array([[*points[0] - [distance, 0.0], 1.0], [*points[0] + [distance, 0.0], 1.0]])
    corners = points[hull(points)]
    edges = np.roll(corners, -1, axis=0) - corners
    outwards = np.column_stack([edges[:, 1], -edges[:, 0]]) / np.linalg.norm(edges, axis=1)[:, None]
    vertices: list[tuple[float, float, float]] = []
    for corner, before, after in zip(corners, np.roll(outwards, 1, axis=0), outwards, strict=True):
        angle = float(np.arccos(np.clip(before @ after, -1.0, 1.0)))
        start, end = corner + distance * before, corner + distance * after
        vertices += [(*start.tolist(), np.tan(angle / 4.0)), (*end.tolist(), 0.0)]
    return np.array(vertices)


def drawing_text(plates: Sequence[Plate], extension: str) -> str:
    """Return plates as the text of a file: "dxf" (a layer for each plate) or "svg" (a group for each)."""
    return _svg(plates) if extension == "svg" else "\n".join(_dxf(plates)) + "\n"


def _svg(plates: Sequence[Plate]) -> str:
    """Return groups of closed paths; the y axis of an image points down."""
    boxes = np.array([plate.box for plate in plates])
    low, high = boxes[:, 0].min(0), boxes[:, 1].max(0)
    width, height = high - low
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.9g}mm" height="{height:.9g}mm" '
        f'viewBox="{low[0]:.9g} {-high[1]:.9g} {width:.9g} {height:.9g}">',
        '<g transform="scale(1,-1)" fill="none" stroke="black" stroke-width="0.1">',
    ]
    for plate in plates:
        lines.append(f"<g><title>{escape(plate.name)}</title>")
        lines += [f'<path d="{_path(outline)} Z"/>' for outline in plate.outlines]
        lines += [f'<circle cx="{x:.9g}" cy="{y:.9g}" r="{plate.hole / 2.0:.9g}"/>' for x, y in plate.holes]
        construction = " ".join(f"M{x:.9g},{y:.9g} L{u:.9g},{v:.9g}" for x, y, u, v in plate.construction)
        lines += [f'<path stroke="blue" d="{construction}"/>'] if construction else []
        lines.append("</g>")
    return "\n".join([*lines, "</g>", "</svg>"]) + "\n"


def _path(outline: Array) -> str:
    """Return the commands of an SVG path; the radius is the chord by twice the sine of half the angle."""
    x, y = outline[0, :2]
    steps = [f"M{x:.9g},{y:.9g}"]
    for (x, y, bulge), (u, v, _) in zip(outline, np.roll(outline, -1, axis=0), strict=True):
        if bulge:
            radius = np.hypot(u - x, v - y) / (2.0 * np.sin(2.0 * np.arctan(bulge)))
            steps.append(f"A{radius:.9g} {radius:.9g} 0 0 1 {u:.9g},{v:.9g}")
        elif (u, v) != tuple(outline[0, :2]):
            steps.append(f"L{u:.9g},{v:.9g}")
    return " ".join(steps)


def _dxf(plates: Sequence[Plate]) -> Iterator[str]:
    """Yield the lines of closed polylines, circles and lines in DXF R12 (Autodesk, *DXF Reference*)."""
    yield from _groups((0, "SECTION"), (2, "HEADER"), (9, "$ACADVER"), (1, "AC1009"))
    yield from _groups((9, "$INSUNITS"), (70, 4), (0, "ENDSEC"), (0, "SECTION"), (2, "ENTITIES"))
    layers = {CONSTRUCTION}
    for plate in plates:
        # R12 has names of letters, digits, $, - and _
        layer = re.sub(r"[^A-Za-z0-9$_-]", "_", plate.name)[:31]
        while layer in layers:
            layer += "_"
        layers.add(layer)
        for outline in plate.outlines:
            yield from _groups((0, "POLYLINE"), (8, layer), (66, 1), (70, 1))
            for x, y, bulge in outline.tolist():
                yield from _groups((0, "VERTEX"), (8, layer), (10, x), (20, y), *[(42, bulge)] * bool(bulge))
            yield from _groups((0, "SEQEND"), (8, layer))
        for x, y in plate.holes.tolist():
            yield from _groups((0, "CIRCLE"), (8, layer), (10, x), (20, y), (40, plate.hole / 2.0))
        for x, y, u, v in plate.construction.tolist():
            yield from _groups((0, "LINE"), (8, CONSTRUCTION), (10, x), (20, y), (11, u), (21, v))
    yield from _groups((0, "ENDSEC"), (0, "EOF"))


def _groups(*groups: tuple[int, float | str]) -> Iterator[str]:
    for code, value in groups:
        yield str(code)
        yield f"{value:.9f}" if isinstance(value, float) else str(value)
