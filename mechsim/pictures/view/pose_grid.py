"""Records of an interactive page: sliders, poses, read-outs."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from mechsim.mechanism.links import GROUND, VIRTUAL_PREFIX
from mechsim.mechanism.mechanism import Mechanism, Up
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.moved_links import moved_links, with_rods
from mechsim.numerics.arrays import Array
from mechsim.pictures.render.frame_poses import errors, factor, returns_to_start
from mechsim.pictures.render.look import Drawn


def quaternions(rotation: Array) -> Array:
    """Return unit quaternions of rotations, (..., 3, 3) -> (..., 4), scalar first and not negative."""
    from scipy.spatial.transform import Rotation

    # scipy 1.15 rejects arrays that are read-only, as those of links that keep their pose are
    flat = Rotation.from_matrix(np.array(rotation).reshape(-1, 3, 3)).as_quat(
        canonical=True, scalar_first=True
    )
    return flat.reshape(*rotation.shape[:-2], 4)


SliderUnit = Literal["rad", "m", "s"]


@dataclass(frozen=True, slots=True)
class Landmark:
    """A named position on a slider: a dead centre, the smallest transmission angle.

    Attributes:
        value: in the unit of the slider.
        label: description in a few words.
        kind: "dead" at the end of a motion, "meets" at a branch point, else "note".
    """

    value: float
    label: str
    kind: Literal["dead", "meets", "note"] = "note"


@dataclass(frozen=True, slots=True)
class Slider:
    """A driver that is moved by hand.

    Attributes:
        name: of the driver, or "time".
        unit: of its nodes.
        nodes: ascending values with known poses, (k,) in SI.
        ring: whether the last node equals the first, one period later.
        start: initial value.
        landmarks: named positions.
    """

    name: str
    unit: SliderUnit
    nodes: Array
    ring: bool
    start: float
    landmarks: tuple[Landmark, ...] = ()


@dataclass(frozen=True, slots=True)
class Readout:
    """A quantity over the grid, with one or several components: a point's position, a joint's coordinate.

    Attributes:
        name: name of the quantity.
        unit: in SI, "rad", "m", "m/s", "".
        components: name of a component -> its values, (n,), or (1,) if it is constant; "" for a scalar.
    """

    name: str
    unit: str
    components: Mapping[str, Array]


@dataclass(frozen=True, slots=True)
class GhostTrack:
    """The links by another method, as differences along a single slider.

    Attributes:
        name: of the method.
        nodes: rising values of the slider, (k,).
        shift: link -> displacement of its first joint, (k, 3) in [m].
        rotation: link -> rotation vector, (k, 3) in [rad].
        by: factor that makes the differences visible.
    """

    name: str
    nodes: Array
    shift: Mapping[str, Array]
    rotation: Mapping[str, Array]
    by: float


@dataclass(frozen=True, slots=True)
class PoseGrid:
    """One assembly, or one method: poses of all moving links at every node of its slider.

    Attributes:
        name: name on the page.
        slider: the driver that is moved.
        position: link -> position of its origin, (n, 3) in [m], or (1, 3) of a link at rest.
        quaternion: link -> its orientation, (n, 4), scalar first, or (1, 4).
        readouts: quantities shown as numbers and as curves.
        ghost: of another method; None without one.
        note: further text on its source.
    """

    name: str
    slider: Slider
    position: Mapping[str, Array]
    quaternion: Mapping[str, Array]
    readouts: tuple[Readout, ...] = ()
    ghost: GhostTrack | None = None
    note: str = ""


@dataclass(frozen=True, slots=True)
class LivePage:
    """Data with which a page solves a mechanism.

    Attributes:
        code: JavaScript that defines `live_solver` and `live_geometry`.
        data: plain data for `live.js`.
        describe: returns the mechanism for changed dimensions, name -> value in SI.
    """

    code: str
    data: Mapping[str, Any]
    describe: Callable[[Mapping[str, float]], Mechanism]


@dataclass(frozen=True, slots=True)
class View(Drawn):
    """The contents of a page.

    Attributes:
        mechanism: the mechanism with the drawn links.
        grids: the choices; the first is shown initially.
        title: heading.
        facts: lines of description.
        up: coordinate axis that points up, as "z" or "-y"; None takes that of the mechanism, else y.
        live: data with which the page solves the mechanism, with variable dimensions; None shows solved poses
            only.
    """

    mechanism: Mechanism
    grids: Sequence[PoseGrid]
    title: str
    facts: Sequence[str] = ()
    up: Up | None = None
    live: LivePage | None = None


def motion_grid(
    name: str,
    mechanism: Mechanism,
    motion: Motion,
    *,
    driver: str,
    unit: SliderUnit = "rad",
    nodes: Array | None = None,
    landmarks: Sequence[Landmark] = (),
    extra: Sequence[Readout] = (),
    speeds: bool = True,
) -> PoseGrid:
    """Return the grid of a motion along a single slider.

    Args:
        name: name on the page.
        mechanism: the mechanism.
        motion: with links, at rising values of the slider.
        driver: name of the slider.
        unit: of its values.
        nodes: its values, (n,); None takes the crank angles.
        landmarks: named positions.
        extra: quantities besides positions, speeds and joints, (n,) each.
        speeds: whether the rates of the motion are shown.
    """
    nodes = motion.angle if nodes is None else nodes
    poses = moved_links(mechanism, motion)
    position = {name: pose.position for name, pose in poses.items()}
    turns = quaternions(np.concatenate([pose.rotation for pose in poses.values()]))
    ends = np.cumsum([len(pose.rotation) for pose in poses.values()])
    quaternion = dict(zip(poses, np.split(turns, ends[:-1]), strict=True))
    slider = Slider(
        driver, unit, nodes, returns_to_start(mechanism, motion), float(nodes[0]), tuple(landmarks)
    )
    return PoseGrid(name, slider, position, quaternion, (*_readouts(mechanism, motion, speeds), *extra))


def with_resting(grid: PoseGrid, rest: PoseGrid) -> PoseGrid:
    """Return a grid of some links with the others at rest, in the only pose of a grid of all links."""
    own = {readout.name: readout for readout in grid.readouts}
    return replace(
        grid,
        position={**rest.position, **grid.position},
        quaternion={**rest.quaternion, **grid.quaternion},
        readouts=tuple(own.get(readout.name, readout) for readout in rest.readouts),
    )


def ascending(motion: Motion) -> slice:
    """Return the rows at which a slider ascends: all for motion laws or a turning crank, half for a swing."""
    return slice(None) if motion.drivers else slice(0, 1 + int(np.argmax(motion.angle)))


def ghost_of(name: str, mechanism: Mechanism, shown: Motion, other: Motion) -> GhostTrack:
    """Return the links by another method, given both motions at the same drivers.

    Args:
        name: name of the method.
        mechanism: the mechanism.
        shown: the motion of the page.
        other: the motion of the other method.
    """
    rows = ascending(other)
    spinning = shown.spinning | other.spinning
    run, exact = (moved_links(mechanism, motion) for motion in (shown, other))
    mechanism = with_rods(mechanism, {})[0]
    deviations = errors(mechanism, run, exact, spinning)
    shift = {link: own[rows] for link, (own, _) in deviations.items()}
    rotation = {link: own[rows] for link, (_, own) in deviations.items()}
    nodes = shown.time if shown.drivers and shown.time is not None else shown.angle
    return GhostTrack(name, nodes[rows], shift, rotation, factor(mechanism, deviations))


def _readouts(mechanism: Mechanism, motion: Motion, speeds: bool) -> list[Readout]:
    """Return positions and speeds of the points that move, and the joints' coordinates."""
    readouts: list[Readout] = []
    for name, point in motion.points.items():
        if name in mechanism.points and mechanism.points[name][0] == GROUND:
            continue
        readouts.append(Readout(name, "m", dict(zip("xyz", point.position.T, strict=True))))
        if speeds:
            speed = np.sqrt((point.velocity**2).sum(1))
            readouts.append(Readout(f"{name} speed", "m/s", {"": speed}))
    for name, joint in motion.joints.items():
        if name.startswith(VIRTUAL_PREFIX):
            continue
        value = np.unwrap(joint.value) if joint.unit == "rad" else joint.value
        readouts.append(Readout(f"joint {name}", joint.unit, {"": value}))
    return readouts
