"""How much room shapes take up over a motion."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from mechsim.maths.arrays import Array
from mechsim.model.joints import KINDS
from mechsim.model.mechanism import Mechanism, Pose, joint_coordinate
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
    """Return the least and greatest displacement along the axis of every joint that slides there, in [m]."""
    found: dict[str, tuple[float, float]] = {}
    for joint in mechanism.joints:
        if KINDS[joint.kind].slides == ("a",):
            along = joint_coordinate(joint, poses[joint.a.link], poses[joint.b.link])[..., 0]
            found[joint.name] = float(along.min()), float(along.max())
    return found
