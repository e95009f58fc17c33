"""Paths of points, assemblies and kinematic diagrams."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim.mechanism.belts import belts_of
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import GROUND, IDENTITY, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.motion_plane import hinged_normals
from mechsim.mechanism.moved_links import moved_links, with_rods
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.pictures.label_positions import Rectangle, placed, shared
from mechsim.pictures.number_text import prefixed, readable
from mechsim.pictures.plots.figure import INK, ROUNDED, STYLES, blank, label_of, point_names, styled
from mechsim.shapes import body
from mechsim.shapes.belts import draw_ropes
from mechsim.shapes.body import stations
from mechsim.shapes.camera import clearest_pose, directions, nice
from mechsim.shapes.gears import racks_of, wheels_of
from mechsim.shapes.guides import CHORDS, contact_points, hidden_links
from mechsim.shapes.shape import vector
from mechsim.shapes.springs import spring_ends

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Annotation


PAPER, SHADE = "#ffffff", "#dfe3e9"
# sizes of symbols, relative to the span of the mechanism
RADIUS, BLOCK, FOOT = 0.018, 0.045, 0.05
# names are readable over lines
BEHIND: dict[str, Any] = {"facecolor": PAPER, "edgecolor": "none", "alpha": 0.75, "pad": 0.5}
NAMES: dict[str, Any] = {"textcoords": "offset points", "bbox": BEHIND, "zorder": 5, "va": "center"}
# symbols of a spring and of a damper: part of the way between its ends, and side; nan lifts the pen
ZIGZAG = [(0.2 + 0.6 * k / 7, 1.0 - k % 2 * 2.0) for k in range(8)]
SPRING = np.array([(0.0, 0.0), (0.15, 0.0), *ZIGZAG, (0.85, 0.0), (1.0, 0.0)])
PISTON = [(0.0, 0.0), (0.45, 0.0), (np.nan, 0.0), (0.45, 0.8), (0.45, -0.8), (np.nan, 0.0)]
DASHPOT = np.array(
    [*PISTON, (0.3, 1.0), (0.7, 1.0), (0.7, -1.0), (0.3, -1.0), (np.nan, 0.0), (0.7, 0.0), (1.0, 0.0)]
)


@styled()
def schematic_plot(mechanism: Mechanism, motion: Motion, forces: Forces | None = None) -> "Figure":
    """Draw a mechanism as a kinematic diagram in a clear pose, with a scale bar (symbols of ISO 3952).

    Revolute joints are circles, on the ground with a hatched foot; sliding joints are blocks on a line;
    spherical and universal joints are filled circles; gears are pitch circles, racks pitch lines; cams have
    their profiles, belts their strands; springs are zigzags, dampers pistons in cylinders. Points and joints
    on the ground have names.
    """
    back, up = directions(mechanism, "iso")
    if hinged_normals(mechanism) and float(np.cross(up, back).sum()) < 0.0:
        back = -back  # the other side would mirror the coordinates
    view = np.column_stack([np.cross(up, back), up])
    pivots = body.fixed_pivots(mechanism)
    mechanism, moved = with_rods(mechanism, moved_links(mechanism, motion))
    poses = {GROUND: IDENTITY, **moved}
    frame = clearest_pose(mechanism, poses, (view[:, 0], view[:, 1]))
    shown = {link: pose.select(frame) for link, pose in poses.items()}
    figure, axes = blank(1, 1, (4.8, 3.6))
    ax, length_scale = axes[0, 0], body.span(mechanism)
    hidden, of_frame = hidden_links(mechanism), body.fixed_links(mechanism)
    for link in mechanism.links:
        if link.polygon:
            corners = np.array([shown[link.name].point(vector(corner)) @ view for corner in link.outline])
            face = "none" if link.name in of_frame else SHADE
            ax.fill(*corners.T, facecolor=face, edgecolor=INK, lw=1.8, zorder=1)
        elif link.name not in hidden:
            _draw_link(ax, [shown[link.name].point(tuple(p)) @ view for p in stations(mechanism, link.name)])
    sliding = body.travels(mechanism, poses)
    joints = [j for j in mechanism.joints if not (KINDS[j.kind].floating or hidden.intersection(j.links))]
    outlines = [*_pitch_lines(mechanism, shown), *_profiles(mechanism, shown), *_legs(joints, shown)]
    for line in [*outlines, *_ropes(mechanism, shown, sliding)]:
        ax.plot(*(line @ view).T, color=INK, lw=0.9 if len(line) > 2 else 1.8, zorder=2)
    # a profile can be larger than all links
    length_scale = max(length_scale, 0.4 * float(ax.dataLim.size.max()))
    for end, other, damper in spring_ends(mechanism, forces):
        a, b = (shown[link].point(point) @ view for link, point in (end, other))
        symbol = _along(DASHPOT if damper else SPRING, a, b, 0.6 * BLOCK * length_scale)
        ax.plot(*symbol.T, color=INK, lw=1.0, zorder=2)
    for joint in joints:
        _draw_joint(ax, joint, shown, view, sliding, length_scale)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.1)
    ax.set_axis_off()
    bar = ax.dataLim.min - [0.0, 2.0 * FOOT * length_scale]
    bar = bar + np.outer([0.0, nice(length_scale / 4.0)], [1.0, 0.0])
    ax.plot(*bar.T, color=INK, lw=2.5, solid_capstyle="butt")
    length = prefixed(bar[1, 0] - bar[0, 0], "m")
    unit = ax.annotate(length, bar[1], (4, 0), textcoords="offset points", va="center")
    named = {name: shown[link].point(local) @ view for name, (link, local) in mechanism.points.items()}
    # a pivot at which a tracked point always stands has the name of the point, as in renderings
    always = [poses[link].point(local) for link, local in mechanism.points.values()]
    for label, end in pivots.values():
        if not any(np.abs(path - end.point).max() < RADIUS * length_scale for path in always):
            named[label] = np.asarray(end.point) @ view
    _write_names(figure, ax, named, bar, unit)
    return figure


def _write_names(
    figure: "Figure", ax: "Axes", named: Mapping[str, Array], bar: Array, unit: "Annotation"
) -> None:
    """Write names next to their points, clear of lines, of the scale bar with its unit, and of each other."""
    figure.draw_without_rendering()
    across, height = figure.bbox.size

    def pixels(points: Array) -> Array:
        return ax.transData.transform(points) * [1.0, -1.0] + [0.0, height]

    box, (end, _) = unit.get_window_extent(), pixels(bar)
    line = float(box.height)
    occupied = [Rectangle(end[0], end[1] - line, box.x1, end[1] + line)]
    curves = [np.column_stack(curve.get_data()) for curve in ax.get_lines()]
    along = np.linspace(0.0, 0.95, 20)
    lines = np.concatenate([pixels(c[:-1] + s * np.diff(c, axis=0)) for c in curves for s in along])
    names = shared({name: pixels(point) for name, point in named.items()})
    written = [
        ax.annotate(label_of(name), tuple(named[name.split(", ")[0]]), (0.0, 0.0), **NAMES)
        for name, _ in names
    ]
    points, widths = [point for _, point in names], [text.get_window_extent().width for text in written]
    spots = placed(points, widths, line, 0.8 * line, (int(across), int(height)), occupied, lines=lines)
    for text, point, (spot, _) in zip(written, points, spots, strict=True):
        off = spot.x_low - point[0], point[1] - 0.5 * (spot.y_low + spot.y_high)
        text.set_position(tuple(72.0 / figure.dpi * np.array(off)))


def _pitch_lines(mechanism: Mechanism, poses: Mapping[str, Pose]) -> Iterator[Array]:
    """Yield the pitch circles of gears and pinions, and the pitch lines of racks, (n, 3)."""
    wheels = {wheel.key: wheel for gear in mechanism.gears for wheel in wheels_of(mechanism, gear)}
    circles = [
        (wheel.end, wheel.radius, wheel.cone.apex + wheel.cone.height if wheel.cone else 0.0)
        for wheel in wheels.values()
    ]
    for coupling, rack, pinion in racks_of(mechanism):
        radius, along = abs(coupling.ratio), np.asarray(rack.a.axis)
        out = np.cross(along, pinion.a.axis) * np.sign(coupling.ratio)
        meet = np.asarray(pinion.a.point) + radius * out
        yield _placed(poses[pinion.a.link], meet + np.linspace(-3.0, 3.0, 3)[:, None] * radius * along)
        circles.append((pinion.b, radius, 0.0))
    for end, radius, height in circles:
        yield _placed(poses[end.link], _circle(end, radius, height))


def _placed(pose: Pose, points: Array) -> Array:
    """Return points of a link, (n, 3), at its pose."""
    return pose.position + points @ pose.rotation.T


def _profiles(mechanism: Mechanism, poses: Mapping[str, Pose]) -> Iterator[Array]:
    """Yield the profiles of cams and curves with their rollers, and belts with their pulleys, (n, 3)."""
    for name, contact in mechanism.contacts.items():
        yield _placed(poses[contact.carrier], contact_points(mechanism.joint(name).a, contact, CHORDS))
        roller = mechanism.joint(contact.force_joint).b
        yield _placed(poses[roller.link], _circle(roller, contact.roller_radius))
    for belt in belts_of(mechanism):
        end, plane = belt.carrier, belt.carrier.frame[:, :2]
        strands = np.concatenate([*belt.points(REVOLUTION / CHORDS)])
        yield _placed(poses[end.link], end.point + np.vstack([strands, strands[:1]]) @ plane.T)
        for centre, radius in zip(belt.centres, np.abs(belt.radii), strict=True):
            pulley = replace(end, point=vector(end.point, plane @ centre))
            yield _placed(poses[end.link], _circle(pulley, radius))


def _ropes(
    mechanism: Mechanism, poses: Mapping[str, Pose], sliding: Mapping[str, tuple[float, float]]
) -> Iterator[Array]:
    """Yield the falls of ropes, and the circles of their drums and pulleys, (n, 3)."""
    canvas = body.Canvas(mechanism, dict(sliding), {})
    draw_ropes(canvas)
    for link, shapes in canvas.out.items():
        for shape in shapes:
            if shape.kind == "capsule":
                yield _placed(poses[link], np.linspace(shape.frm, shape.to, 3))
            elif shape.kind == "cylinder" and shape.sizes[0] > 3.0 * canvas.r:
                rim = End(link, shape.frm, vector(shape.frame[:, 2]))
                yield _placed(poses[link], _circle(rim, shape.sizes[0]))


def _circle(end: End, radius: float, height: float = 0.0) -> Array:
    """Return a circle about the axis of a joint end, (n, 3) in the frame of its link."""
    angle = np.linspace(0.0, REVOLUTION, 73)
    ring = np.column_stack([radius * np.cos(angle), radius * np.sin(angle), np.full_like(angle, height)])
    return np.asarray(end.point) + ring @ end.frame.T


def _along(symbol: Array, a: Array, b: Array, half: float) -> Array:
    """Return the symbol of a spring or damper between two points, (n, 2), with a half width."""
    along = (b - a) / max(float(np.linalg.norm(b - a)), 1e-300)
    return a + symbol[:, :1] * (b - a) + half * symbol[:, 1:] * np.array([-along[1], along[0]])


def _legs(joints: Sequence[Joint], poses: Mapping[str, Pose]) -> Iterator[Array]:
    """Yield the lines of sliding joints between moving links, from point to point, (2, 3)."""
    for joint in joints:
        if KINDS[joint.kind].slides and GROUND not in (joint.a.link, joint.b.link):
            yield np.array([poses[end.link].point(end.point) for end in (joint.a, joint.b)])


def _draw_link(ax: "Axes", points: list[Array]) -> None:
    """Draw the body of a link; a link with three or more joints is a filled polygon."""
    lines = np.array([*body.edges([np.append(point, 0.0) for point in points])]).reshape(-1, 2, 3)[..., :2]
    if len(points) > 2 and len(lines) > 2:
        around = np.concatenate([lines[:, 0], lines[:, 1]])
        order = np.argsort(np.arctan2(*(around - around.mean(0)).T[::-1]))
        ax.fill(*around[order].T, color=SHADE, zorder=1)
    for line in lines:
        ax.plot(*line.T, color=INK, lw=1.8, solid_capstyle="round", zorder=2)


def _draw_joint(
    ax: "Axes",
    joint: Joint,
    poses: dict[str, Pose],
    view: Array,
    sliding: dict[str, tuple[float, float]],
    length_scale: float,
) -> None:
    """Draw the symbol of a joint, and a foot where it is on the ground."""
    from matplotlib.patches import Circle

    kind, slides, block = KINDS[joint.kind], len(KINDS[joint.kind].slides), BLOCK * length_scale
    centre = poses[joint.b.link].point(joint.b.point) @ view
    grounded = slides < 2 and GROUND in joint.links
    axis = poses[joint.a.link].rotation @ np.asarray(joint.a.axis) @ view
    along = float(np.linalg.norm(axis))
    if slides == 1 and along > 0.1:
        axis, (low, high) = axis / along, sliding[joint.name]
        origin = poses[joint.a.link].point(joint.a.point) @ view
        across = np.array([-axis[1], axis[0]])
        rail = origin + np.outer([low * along - block, high * along + block], axis)
        ax.plot(*rail.T, color=INK, lw=1.0, zorder=1)
        if grounded:
            _hatch(ax, rail - 0.6 * block * across, length_scale)
        sides = block * np.array([[-1.0, -0.6], [1.0, -0.6], [1.0, 0.6], [-1.0, 0.6]])
        corners = centre + sides @ np.array([axis, across])
        ax.fill(*corners.T, facecolor=PAPER, edgecolor=INK, lw=1.2, zorder=3)
        return
    if grounded:
        foot = centre + FOOT * length_scale * np.array([[-0.6, -1.0], [0.6, -1.0]])
        ax.fill(*np.vstack([centre, foot]).T, facecolor=PAPER, edgecolor=INK, lw=1.0, zorder=3)
        _hatch(ax, foot, length_scale)
    style = {"facecolor": INK if kind.ball or not kind.hinge else PAPER, "edgecolor": INK, "lw": 1.2}
    ax.add_patch(Circle(tuple(centre), RADIUS * length_scale, zorder=4, **style))


def _hatch(ax: "Axes", line: Array, length_scale: float) -> None:
    """Draw a line of the ground with its hatching below or to the right."""
    ax.plot(*line.T, color=INK, lw=1.2, zorder=2)
    along = line[1] - line[0]
    length = float(np.linalg.norm(along))
    along = along / length
    below = np.array([along[1], -along[0]])
    for share in np.linspace(0.1, 1.0, max(4, round(length / (0.02 * length_scale)))):
        start = line[0] + share * length * along
        stroke = np.array([start, start + 0.35 * FOOT * length_scale * (below - along)])
        ax.plot(*stroke.T, color=INK, lw=0.7, zorder=2)


@styled()
def coupler_curve(mechanism: Mechanism, motion: Motion) -> "Figure":
    """Draw the paths of points: in their common plane if there is one, else seen along Z, X and Y.

    Args:
        mechanism: the mechanism with these points; gives the colours.
        motion: paths drawn as lines.
    """
    names, colours = point_names(motion), body.point_colours(mechanism)
    positions = {name: motion.points[name].position for name in names}
    everything = np.vstack(list(positions.values()))
    factor, unit = readable(everything, "m")
    spread, scale = float(np.ptp(everything, axis=0).max()), float(np.abs(everything).max())
    flat = np.ptp(everything[:, 2]) <= max(1e-9 * spread, ROUNDED * scale)
    views = [(0, 1)] if flat else [(0, 1), (2, 1), (0, 2)]
    figure, axes = blank(1, len(views), (max(5.4, 3.6 * len(views) + 0.4), 3.4))
    for ax, (i, j) in zip(axes[0], views, strict=True):
        for number, (name, position) in enumerate(positions.items()):
            colour, style = colours[name], STYLES[number % 3]
            ax.plot(*(position[:, [i, j]] / factor).T, style, color=colour, label=label_of(name))
            ax.plot(*(position[0, [i, j]] / factor), "o", ms=4, color=colour)
        ax.set_xlabel(f"{'xyz'[i]} [{unit}]")
        ax.set_ylabel(f"{'xyz'[j]} [{unit}]")
        if spread < ROUNDED * scale:
            # a point at rest is drawn as a point, not as a path of rounding
            half, middle = 0.5 * scale / factor, everything[0] / factor
            ax.set_xlim(middle[i] - half, middle[i] + half)
            ax.set_ylim(middle[j] - half, middle[j] + half)
            ax.set_title(f"stands still within {ROUNDED * scale:.1g} m")
        ax.set_aspect("equal", adjustable="datalim")
    axes[0, 0].legend(loc="best")
    return figure
