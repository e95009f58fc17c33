"""Poses of every link in every frame, and of a ghost: the links with a magnified error of the run."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import InputError
from mechsim.mechanism.links import GROUND, IDENTITY, Pose, Vector
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.moved_links import moved_links
from mechsim.numerics.arrays import Array
from mechsim.pictures.number_text import power_of_ten
from mechsim.shapes.body import span
from mechsim.shapes.camera import nice

# largest displacement of the ghost, relative to the mechanism's size, and its largest rotation in [rad]
MAX_GHOST_DISTANCE, MAX_GHOST_ANGLE = 0.15, 0.35


@dataclass(frozen=True, slots=True)
class Ghost:
    """Poses of a ghost.

    Attributes:
        poses: link -> poses, (n, ...); moving links only.
        by: factor on the error.
        source: source of the motion that the ghost shows.
    """

    poses: Mapping[str, Pose]
    by: float
    source: str

    @property
    def legend(self) -> str:
        """Text about the ghost in a picture."""
        exponent = int(np.floor(np.log10(self.by) + 1e-9))
        lead, power = self.by / 10.0**exponent, power_of_ten(exponent)
        large = power if round(lead, 6) == 1.0 else f"{lead:.3g}·{power}"
        return f"ghost: {self.source}, error × {large if exponent > 3 else f'{self.by:.3g}'}"  # noqa: RUF001


def errors(
    mechanism: Mechanism, run: Mapping[str, Pose], exact: Mapping[str, Pose], spinning: frozenset[str]
) -> dict[str, tuple[Array, Array]]:
    """Return the displacement of each moving link from its pose by the closed form.

    Args:
        mechanism: the mechanism with these links.
        run: link -> poses drawn solid, (n, ...).
        exact: link -> poses at the same instants.
        spinning: links whose spin about the line of their joints is undetermined; it is left out.

    Returns:
        Link -> displacement of its first joint, (n, 3) in [m], and turn as a vector, (n, 3) in [rad].
    """
    from scipy.spatial.transform import Rotation

    deviations: dict[str, tuple[Array, Array]] = {}
    for link in mechanism.links:
        run_pose, exact_pose = run[link.name], exact[link.name]
        anchor = mechanism.ends(link.name)[0].point
        if link.name in spinning:
            # the unit vector between the first two distinct joints
            first, *others = (np.asarray(end.point) for end in mechanism.ends(link.name))
            line = max((other - first for other in others), key=np.linalg.norm)
            line = line / np.linalg.norm(line)
            rotation = np.cross(run_pose.rotation @ line, exact_pose.rotation @ line)
        else:
            relative = exact_pose.rotation @ np.swapaxes(run_pose.rotation, 1, 2)
            rotation = Rotation.from_matrix(relative).as_rotvec()
        deviations[link.name] = exact_pose.point(anchor) - run_pose.point(anchor), rotation
    return deviations


def factor(mechanism: Mechanism, deviations: Mapping[str, tuple[Array, Array]]) -> float:
    """Return the round factor that makes errors visible and keeps the ghost in the picture."""
    shift, rotation = (
        max(float(np.abs(own).max()) for own in kind) for kind in zip(*deviations.values(), strict=True)
    )
    worst = max(shift / (MAX_GHOST_DISTANCE * span(mechanism)), rotation / MAX_GHOST_ANGLE)
    return 1.0 if not worst > 0.0 else nice(1.0 / worst)


def magnified(
    mechanism: Mechanism, run: Mapping[str, Pose], deviations: Mapping[str, tuple[Array, Array]], by: float
) -> dict[str, Pose]:
    """Return the poses of the ghost: those of the run, displaced by the errors times a factor.

    To first order in the error the ghost's joints hold together as the closed form's do.
    """
    from scipy.spatial.transform import Rotation

    poses: dict[str, Pose] = {}
    for link in mechanism.links:
        (shift, rotation_vector), pose = deviations[link.name], run[link.name]
        anchor: Vector = mechanism.ends(link.name)[0].point
        rotation = Rotation.from_rotvec(by * rotation_vector).as_matrix() @ pose.rotation
        poses[link.name] = Pose(pose.point(anchor) + by * shift - rotation @ np.asarray(anchor), rotation)
    return poses


# number of points of a path for which it looks smooth, and from twice of which samples are left out
PATH_POINTS = 360
# differences, relative to the size and in [rad], below which two frames look the same
VISIBLE_DIFFERENCE = 1e-3


@dataclass(frozen=True, slots=True)
class FramePoses:
    """Poses of all links frame by frame, and the finer paths of the tracked points.

    Attributes:
        angle: crank angle of each frame, (n,) in [rad].
        poses: link -> poses, ground included.
        points: tracked point -> position in each frame, (n, 3) in [m].
        paths: tracked point -> its path over the whole motion, (m, 3) in [m].
        passed: number of points of its path that each tracked point has passed, (n,).
        vectors: "velocity", "acceleration" and, if given, "force" and "moment" -> point or joint ->
            vector in each frame, (n, 3) in SI.
        starts: point or joint -> start of its arrows in each frame, (n, 3) in [m].
        time: of each frame under motion laws, (n,) in [s]; else None.
    """

    angle: Array
    poses: Mapping[str, Pose]
    points: Mapping[str, Array]
    paths: Mapping[str, Array]
    passed: NDArray[np.intp]
    vectors: Mapping[str, Mapping[str, Array]]
    starts: Mapping[str, Array]
    time: Array | None = None

    def __len__(self) -> int:
        return len(self.angle)

    def position(self, link: str, point: Vector, frame: int) -> Array:
        """Return the position of a point of a link in a frame, (3,) in [m]."""
        return self.poses[link].select(frame).point(point)

    def instant(self, frame: int) -> str:
        """Return the label of a frame: its crank angle, or without a crank its time."""
        if self.time is not None:
            return f"{self.time[frame]:.3f} s"
        return f"crank {round(np.rad2deg(float(self.angle[frame])), 1) % 360.0:5.1f}°"

    @property
    def closed(self) -> bool:
        """Whether the paths are closed."""
        rotation = abs(float(self.angle[-1] - self.angle[0]))
        return rotation > 6.0 and all(
            float(np.linalg.norm(path[-1] - path[0])) < 1e-3 * float(np.ptp(path, axis=0).max())
            for path in self.paths.values()
        )


def returns_to_start(
    mechanism: Mechanism, motion: Motion, position_tolerance: float = 1e-9, angle_tolerance: float = 1e-6
) -> bool:
    """Return whether the last pose of a motion equals the first, within a part of the size and in [rad]."""
    if len(motion) < 3:
        return False
    return all(
        float(np.abs(moved.position[-1] - moved.position[0]).max())
        < position_tolerance * mechanism.characteristic_length
        and float(np.abs(moved.rotation[-1] - moved.rotation[0]).max()) < angle_tolerance
        for name, moved in motion.links.items()
        if name not in motion.spinning
    )


def returns_visibly(mechanism: Mechanism, motion: Motion) -> bool:
    """Return whether the last pose of a motion looks like the first."""
    return returns_to_start(mechanism, motion, VISIBLE_DIFFERENCE, VISIBLE_DIFFERENCE)


def samples_in_frame(frames: float) -> int:
    """Return how many samples lead from one of several frames to the next, so that paths look smooth."""
    return int(np.ceil(PATH_POINTS / frames)) if 1 <= frames < PATH_POINTS else 1


def frame_poses(
    mechanism: Mechanism,
    motion: Motion,
    angles: ArrayLike | None = None,
    forces: Mapping[str, ArrayLike] | None = None,
    moments: Mapping[str, ArrayLike] | None = None,
    every: int = 1,
) -> FramePoses:
    """Return the frames of a motion, or of the poses it passes at given crank angles.

    Paths pass through all samples of the motion, also between its frames.

    Args:
        mechanism: the mechanism.
        motion: its motion.
        angles: crank angles of the frames in [rad]; None takes every sample, or each `every`-th.
        forces: tracked point or joint -> force at each sample, (len(motion), 3) in [N], for arrows.
        moments: likewise moments, in [N m].
        every: number of samples from one frame to the next.

    Raises:
        InputError: where the motion lacks a link, holds a NaN, or does not reach an angle.
    """
    poses = {GROUND: IDENTITY, **moved_links(mechanism, motion)}
    for name, pose in poses.items():
        if not (np.isfinite(pose.position).all() and np.isfinite(pose.rotation).all()):
            raise InputError(f"the motion of link {name!r} holds NaN or infinity and cannot be drawn")
    step = max(1, len(motion) // PATH_POINTS)
    fine = np.unique(np.append(np.arange(0, len(motion), step), len(motion) - 1))
    moving = {name: point for name, point in mechanism.points.items() if point[0] != GROUND}
    paths = {name: poses[link].select(fine).point(local) for name, (link, local) in moving.items()}
    indices = frame_indices(motion, angles, every)
    passed = np.searchsorted(fine, indices + 1e-9, side="right")
    own = {name: motion.points[name] for name in moving if name in motion.points}
    shown = {
        "velocity": {name: point.velocity for name, point in own.items()},
        "acceleration": {name: point.acceleration for name, point in own.items()},
        "force": _checked(mechanism, motion, "force", forces or {}),
        "moment": _checked(mechanism, motion, "moment", moments or {}),
    }
    vectors = {
        kind: {name: mixed(values, indices) for name, values in by_name.items()}
        for kind, by_name in shown.items()
    }
    poses = {name: _between(pose, indices) for name, pose in poses.items()}
    joints = {joint.name: (joint.b.link, joint.b.point) for joint in mechanism.joints}
    starts = {
        name: np.broadcast_to(poses[link].point(local), (len(indices), 3))
        for name, (link, local) in {**joints, **mechanism.points}.items()
    }
    points = {name: starts[name] for name in mechanism.points}
    requested = mixed(motion.angle, indices)
    timed = motion.drivers or not mechanism.has_crank
    time = mixed(motion.time, indices) if timed and motion.time is not None else None
    return FramePoses(requested, poses, points, paths, passed, vectors, starts, time)


def ghost_of_run(
    mechanism: Mechanism, run: Motion, exact: Motion, angles: ArrayLike | None, every: int, by: float | None
) -> Ghost:
    """Return the ghost of a run with its error magnified by a factor, or by an automatic one.

    Args:
        mechanism: the mechanism.
        run: its motion.
        exact: the same motion by the closed form, sample by sample.
        angles: as in `frame_poses`.
        every: likewise.
        by: the factor; None for one that makes errors visible.
    """
    if not np.allclose(exact.angle, run.angle, rtol=0.0, atol=1e-9):
        raise InputError("the ghost stands at other crank angles than the run; solve it at the run's")
    # errors are taken at the samples and then interpolated, so that the interpolation error is not magnified
    solid, other = (frame_poses(mechanism, motion).poses for motion in (run, exact))
    deviations = errors(mechanism, solid, other, exact.spinning | run.spinning)
    by = factor(mechanism, deviations) if by is None else by
    indices = frame_indices(run, angles, every)
    deviations = {
        name: (mixed(shift, indices), mixed(rotation, indices))
        for name, (shift, rotation) in deviations.items()
    }
    poses = magnified(mechanism, frame_poses(mechanism, run, angles, every=every).poses, deviations, by)
    return Ghost(poses, by, exact.source)


def frame_indices(motion: Motion, angles: ArrayLike | None, every: int) -> Array:
    """Return the positions of frames among the samples of a motion, as fractional indices."""
    last = len(motion) - 1
    usual = np.unique(np.append(np.arange(0, last + 1, every), last))
    if angles is not None:
        requested = np.atleast_1d(np.asarray(angles, dtype=np.float64))
        # the samples themselves need no search, which a crank that swings would not allow
        if not np.array_equal(requested, motion.angle[usual[: len(requested)]]):
            return sample_indices(motion.angle, requested)
        usual = usual[: len(requested)]
    return usual.astype(np.float64)


def _checked(
    mechanism: Mechanism, motion: Motion, kind: str, loads: Mapping[str, ArrayLike]
) -> dict[str, Array]:
    """Return loads, (n, 3) each; raise InputError for an unknown point or joint, or a wrong vector."""
    names = list(dict.fromkeys([*mechanism.points, *(joint.name for joint in mechanism.joints)]))
    vectors = {name: np.asarray(vector, dtype=np.float64) for name, vector in loads.items()}
    for name, vector in vectors.items():
        if name not in names or vector.shape != (len(motion), 3):
            raise InputError(
                f"{kind} at {name!r} of shape {vector.shape}: give ({len(motion)}, 3) numbers at one of "
                f"{', '.join(names)}"
            )
        if not np.isfinite(vector).all():
            raise InputError(f"{kind} at {name!r} holds NaN or infinity and cannot be drawn")
    return vectors


def sample_indices(angles: Array, requested: Array) -> Array:
    """Return the positions of crank angles among the samples, as fractional indices.

    Of a crank that swings to and fro the longest stretch in one direction counts.
    """
    turns = np.sign(np.diff(angles))
    ends = np.concatenate([[0], np.flatnonzero(turns[1:] != turns[:-1]) + 1, [len(angles) - 1]])
    moving = np.where(turns[ends[:-1]] == 0.0, 0, np.diff(ends)) if len(turns) else np.zeros(1)
    longest = int(np.argmax(moving))
    first, last = (int(ends[longest]), int(ends[longest + 1])) if moving[longest] else (0, 0)
    direction = 1.0 if angles[last] >= angles[first] else -1.0
    rising, requested = direction * angles[first : last + 1], direction * requested
    if len(rising) < 2:
        raise InputError("the crank stands still, so frames cannot be chosen by its angle")
    slack = 1e-6
    if requested.min() < rising[0] - slack or requested.max() > rising[-1] + slack:
        raise InputError(
            f"frames from {requested.min():.6g} to {requested.max():.6g} rad are requested, "
            f"but the motion goes only from {rising[0]:.6g} to {rising[-1]:.6g} rad"
        )
    return np.interp(requested, rising, np.arange(first, last + 1, dtype=np.float64))


def _between(pose: Pose, indices: Array) -> Pose:
    """Return poses at fractional indices, accurate enough for pictures only."""
    whole = indices.astype(np.intp)
    if pose.position.ndim == 1 or np.array_equal(whole, indices):
        return pose.select(whole)
    u, _, v = np.linalg.svd(mixed(pose.rotation, indices))  # the rotation nearest to the mixture
    return Pose(mixed(pose.position, indices), u @ v)


def mixed(values: Array, indices: Array) -> Array:
    """Return values at fractional indices of the leading axis, on straight lines between samples."""
    low = np.minimum(indices.astype(np.intp), max(len(values) - 2, 0))
    high = np.minimum(low + 1, len(values) - 1)
    share = (indices - low).reshape(-1, *[1] * (values.ndim - 1))
    return (1.0 - share) * values[low] + share * values[high]
