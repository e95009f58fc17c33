"""Kinematic diagram of a mechanism, for papers: links as lines, joints as the symbols of textbooks."""

from typing import TYPE_CHECKING

import numpy as np

from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import Joint
from mechsim.model.link_poses import moved_links
from mechsim.model.links import GROUND, IDENTITY, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion
from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import prefixed
from mechsim.pictures.plots.figure import blank, label_of, styled
from mechsim.shapes import span
from mechsim.shapes.body import edges, stations, travels
from mechsim.shapes.camera import clearest_pose, directions, nice

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, PAPER, SHADE = "#1b2028", "#ffffff", "#dfe3e9"
# sizes of symbols, relative to the span of the mechanism
RADIUS, BLOCK, FOOT = 0.018, 0.045, 0.05


@styled()
def schematic_plot(mechanism: Mechanism, motion: Motion) -> "Figure":
    """Draw a mechanism as a kinematic diagram in its clearest pose, with a scale bar.

    Revolute joints are circles, on the ground with a hatched foot; sliding joints are blocks on a line;
    spherical and universal joints are filled circles. Points and joints on the ground bear their names.
    """
    poses = {GROUND: IDENTITY, **moved_links(mechanism, motion)}
    back, up = directions(mechanism, "iso")
    view = np.column_stack([np.cross(up, back), up])
    frame = clearest_pose(mechanism, poses, (view[:, 0], view[:, 1]))
    shown = {link: pose if pose.position.ndim == 1 else pose.select(frame) for link, pose in poses.items()}
    figure, axes = blank(1, 1, (4.8, 3.6))
    ax, length_scale = axes[0, 0], span(mechanism)
    for link in mechanism.links:
        _draw_link(ax, [shown[link.name].point(tuple(p)) @ view for p in stations(mechanism, link.name)])
    sliding = travels(mechanism, poses)
    for joint in mechanism.joints:
        _draw_joint(ax, joint, shown, view, sliding, length_scale)
    names = {name: shown[link].point(local) @ view for name, (link, local) in mechanism.points.items()}
    grounded = {name: joint.a.point for name, joint in _ground_pivots(mechanism).items()}
    names |= {name: shown[GROUND].point(point) @ view for name, point in grounded.items()}
    middle = np.mean(list(names.values()), axis=0) if names else np.zeros(2)
    for name, point in names.items():
        right, above = point[0] >= middle[0], name in grounded or point[1] >= middle[1]
        offset = (7.0 if right else -7.0, 7.0 if above else -7.0)
        aligned = {"ha": "left" if right else "right", "va": "center"}
        ax.annotate(label_of(name), tuple(point), offset, textcoords="offset points", **aligned)
    ax.set_aspect("equal", adjustable="datalim")
    ax.margins(0.1)
    ax.set_axis_off()
    length = nice(length_scale / 4.0)
    low = ax.dataLim.min
    bar = np.array(
        [[low[0], low[1] - 2.0 * FOOT * length_scale], [low[0] + length, low[1] - 2.0 * FOOT * length_scale]]
    )
    ax.plot(*bar.T, color=INK, lw=2.5, solid_capstyle="butt")
    ax.annotate(prefixed(length, "m"), bar[1], (4, 0), textcoords="offset points", va="center")
    return figure


def _ground_pivots(mechanism: Mechanism) -> dict[str, Joint]:
    return {j.name: j for j in mechanism.joints if j.a.link == GROUND and KINDS[j.kind].pivot}


def _draw_link(ax: "Axes", points: list[Array]) -> None:
    """Draw the body of a link; one with three or more joints is a filled polygon."""
    lines = list(edges([np.append(point, 0.0) for point in points]))
    if len(points) > 2 and len(lines) > 2:
        around = np.array([line[0][:2] for line in lines] + [line[1][:2] for line in lines])
        order = np.argsort(np.arctan2(*(around - around.mean(0)).T[::-1]))
        ax.fill(*around[order].T, color=SHADE, zorder=1)
    for a, b in lines:
        ax.plot(*np.array([a[:2], b[:2]]).T, color=INK, lw=1.8, solid_capstyle="round", zorder=2)


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

    kind = KINDS[joint.kind]
    centre = poses[joint.b.link].point(joint.b.point) @ view
    grounded = GROUND in (joint.a.link, joint.b.link)
    axis = poses[joint.a.link].rotation @ np.asarray(joint.a.axis) @ view
    along = float(np.linalg.norm(axis))
    if joint.name in sliding and along > 0.1:
        axis, (low, high) = axis / along, sliding[joint.name]
        origin = poses[joint.a.link].point(joint.a.point) @ view
        reach = np.array([low * along - BLOCK * length_scale, high * along + BLOCK * length_scale])
        rail = origin + reach[:, None] * axis
        ax.plot(*rail.T, color=INK, lw=1.0, zorder=1)
        if grounded:
            _hatch(ax, rail - 0.6 * BLOCK * length_scale * np.array([-axis[1], axis[0]]), length_scale)
        sides = BLOCK * length_scale * np.array([[-1.0, -0.6], [1.0, -0.6], [1.0, 0.6], [-1.0, 0.6]])
        corners = centre + sides @ np.array([axis, [-axis[1], axis[0]]])
        ax.fill(*corners.T, facecolor=PAPER, edgecolor=INK, lw=1.2, zorder=3)
        return
    if grounded:
        foot = centre + FOOT * length_scale * np.array([[-0.6, -1.0], [0.6, -1.0]])
        ax.fill(*np.vstack([centre, foot]).T, facecolor=PAPER, edgecolor=INK, lw=1.0, zorder=3)
        _hatch(ax, foot, length_scale)
    face = INK if kind.ball or not kind.hinge else PAPER
    ax.add_patch(
        Circle(tuple(centre), RADIUS * length_scale, facecolor=face, edgecolor=INK, lw=1.2, zorder=4)
    )


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
