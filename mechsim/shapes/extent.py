"""How much room shapes take up over a motion."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import Joint, joint_coordinate
from mechsim.model.links import Pose
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.shapes.shape import Shape


def extent(drawn: Iterable[tuple[Pose, Sequence[Shape]]]) -> tuple[Array, Array]:
    """Return balls that hold links in all their poses: centres (k, 3) and radii (k,) in [m].

    Args:
        drawn: pose or poses of a link, and its shapes.
    """
    centres, radii = [np.empty((0, 3))], [np.empty(0)]
    for poses, shapes in drawn:
        for shape in shapes:
            points, radius = shape.bounds
            for point in points:
                placed = np.atleast_2d(poses.point(tuple(point)))
                centres.append(placed)
                radii.append(np.full(len(placed), radius))
    return np.vstack(centres), np.concatenate(radii)


def travels(mechanism: Mechanism, poses: Mapping[str, Pose]) -> dict[str, tuple[float, float]]:
    """Return the least and greatest displacement of every joint that slides along or across its axis."""
    found: dict[str, tuple[float, float]] = {}
    for joint in mechanism.joints:
        if 0 < len(KINDS[joint.kind].slides) < 3:
            along = displacement(joint, poses[joint.a.link], poses[joint.b.link])
            found[joint.name] = float(along.min()), float(along.max())
    return found


def displacement(joint: Joint, pose_a: Pose, pose_b: Pose) -> Array:
    """Return how far a joint has slid along its axis, or how far off it in any direction, (...,) in [m]."""
    coordinate = joint_coordinate(joint, pose_a, pose_b)
    slides = len(KINDS[joint.kind].slides)
    return coordinate[..., 0] if slides < 2 else np.linalg.norm(coordinate[..., :slides], axis=-1)
