"""Records of a page from motions that are already solved."""

from collections.abc import Sequence

import numpy as np

from mechsim.model.link_poses import moved_links
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import JointMotion, Motion
from mechsim.numerics.arrays import Array
from mechsim.pictures.render.frame_poses import comes_round
from mechsim.pictures.render.ghost import errors, factor
from mechsim.pictures.view.interpolation import interpolated, quaternions
from mechsim.pictures.view.records import GhostTrack, Mark, PoseGrid, Readout, Slider, SliderUnit


def motion_grid(
    name: str,
    mechanism: Mechanism,
    motion: Motion,
    *,
    driver: str,
    unit: SliderUnit = "rad",
    nodes: Array | None = None,
    marks: Sequence[Mark] = (),
    extra: Sequence[Readout] = (),
    ghost: GhostTrack | None = None,
    speeds: bool = True,
) -> PoseGrid:
    """Return the grid of a motion along one slider.

    Args:
        name: as the page offers it.
        mechanism: what moves.
        motion: with links, at rising values of the slider.
        driver: what the slider is called.
        unit: of its values.
        nodes: its values, (n,); None takes the crank angles.
        marks: places with a name.
        extra: quantities besides places, speeds and joints, (n,) each.
        ghost: of another road.
        speeds: whether the motion's rates are told.
    """
    nodes = motion.angle if nodes is None else nodes
    poses = moved_links(mechanism, motion)
    position = {name: pose.position for name, pose in poses.items()}
    quaternion = {name: quaternions(pose.rotation) for name, pose in poses.items()}
    slider = Slider(driver, unit, nodes, comes_round(mechanism, motion), float(nodes[0]), tuple(marks))
    told = (*_readouts(mechanism, motion, speeds), *extra)
    return PoseGrid(name, (slider,), position, quaternion, told, ghost)


def ghost_of(
    name: str, mechanism: Mechanism, shown: Motion, other: Motion, rows: slice = slice(None)
) -> GhostTrack:
    """Return where another road puts the links, given both motions at the same drivers.

    Args:
        name: of the road.
        mechanism: what moves.
        shown: the motion of the page's own road.
        other: that of the other.
        rows: instants over which the slider rises: all of a crank that turns, half of a swing.
    """
    spinning = shown.spinning | other.spinning
    found = errors(mechanism, moved_links(mechanism, shown), moved_links(mechanism, other), spinning)
    shift = {link: pair[0][rows] for link, pair in found.items()}
    turn = {link: pair[1][rows] for link, pair in found.items()}
    nodes = shown.time if shown.drivers and shown.time is not None else shown.angle
    return GhostTrack(name, nodes[rows], shift, turn, factor(mechanism, found))


def between(grid: PoseGrid, exact: Motion, at: Array) -> float:
    """Return the largest error of a tracked or joint place between the nodes of a slider, in [m].

    Args:
        grid: with one slider.
        exact: the motion solved at values of the slider.
        at: these values, (n,).
    """
    worst = 0.0
    for link, moved in exact.links.items():
        for i, value in enumerate(at):
            place = interpolated(grid.sliders, grid.position[link], [float(value)])
            worst = max(worst, float(np.linalg.norm(place - moved.position[i])))
    return worst


def _readouts(mechanism: Mechanism, motion: Motion, speeds: bool) -> list[Readout]:
    """Return places and speeds of the points that move, and the joints' coordinates."""
    found: list[Readout] = []
    for name, point in motion.points.items():
        if name in mechanism.points and mechanism.points[name][0] == GROUND:
            continue
        found.append(Readout(name, "m", dict(zip("xyz", point.position.T, strict=True))))
        if speeds:
            speed = np.sqrt((point.velocity**2).sum(1))
            found.append(Readout(f"{name} speed", "m/s", {"": speed}))
    for name, joint in motion.joints.items():
        found.append(Readout(f"joint {name}", joint.unit, {"": _unwound(joint)}))
    return found


def _unwound(joint: JointMotion) -> Array:
    return np.unwrap(joint.value) if joint.unit == "rad" else joint.value
