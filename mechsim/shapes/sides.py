"""Which side of the frame a shaft leads to, so that it meets as little as can be."""

from collections.abc import Mapping

import numpy as np

from mechsim.model.joint_kinds import KINDS
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.shapes.body import edges, rod_radius, stations


def free_sides(mechanism: Mechanism, poses: Mapping[str, Pose]) -> dict[str, float]:
    """Return the side of every ground joint where a shaft and its bearing are farthest from all rods.

    Args:
        mechanism: whose joints.
        poses: link -> pose or poses; links left out do not count.

    Returns:
        Joint -> +1 or -1, along the axis of its end on the ground.
    """
    reach, share = 9.0 * rod_radius(mechanism), np.linspace(0.0, 1.0, 9)[:, None]
    rods = {
        link.name: np.array([a + share * (b - a) for a, b in edges(stations(mechanism, link.name))])
        for link in mechanism.links
        if link.name in poses
    }
    sides: dict[str, float] = {}
    for joint in mechanism.joints:
        for ground, moving in ((joint.a, joint.b), (joint.b, joint.a)):
            if not KINDS[joint.kind].pivot or KINDS[joint.kind].ball or ground.link != GROUND:
                continue
            gaps = {}
            for side in (-1.0, 1.0):
                along = np.linspace(0.25, 1.0, 5)[:, None] * reach * side
                shaft = np.asarray(ground.point) + along * np.asarray(ground.axis)
                gaps[side] = min(
                    (_gap(shaft, poses[link], rod) for link, rod in rods.items() if link != moving.link),
                    default=0.0,
                )
            inward = float((_middle(mechanism) - np.asarray(ground.point)) @ np.asarray(ground.axis))
            # a clear difference decides; else the shaft leads off the mechanism
            clear = abs(gaps[1.0] - gaps[-1.0]) > 2.0 * rod_radius(mechanism)
            sides[joint.name] = (
                max(gaps, key=gaps.__getitem__) if clear else (1.0 if inward < -reach / 90.0 else -1.0)
            )
    return sides


def _gap(places: Array, pose: Pose, rods: Array) -> float:
    """The least distance between places, (k, 3), and points of rods in all poses of their link."""
    local = rods.reshape(-1, 3)
    if not len(local):
        local = np.zeros((1, 3))
    rotation, position = np.atleast_3d(pose.rotation).reshape(-1, 3, 3), pose.position.reshape(-1, 1, 3)
    moved = (position + local @ np.swapaxes(rotation, -1, -2)).reshape(-1, 1, 3)
    return float(np.sqrt(((moved - places) ** 2).sum(-1)).min())


def _middle(mechanism: Mechanism) -> Array:
    """The middle of all joints on the ground."""
    return np.array([end.point for end in mechanism.ends(GROUND)]).mean(0)
