"""Joint coordinates and positions of points, with their rates, from the motion of links."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim.kinematics.loops.tree import SpanningTree
from mechsim.kinematics.vector_method.link_frames import frame_of, joint_coordinates, motions_of_joint
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Joint
from mechsim.mechanism.link_poses import rotated
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import JointMotion, LinkMotion, Motion, PointMotion
from mechsim.numerics.arrays import REVOLUTION, Array, cross
from mechsim.numerics.jets import unwrapped_angles


def with_all_joints(mechanism: Mechanism, motion: Motion) -> Motion:
    """Return a motion with every coordinate, also of the joints that close loops.

    Args:
        mechanism: the mechanism.
        motion: its motion with links; joints that it contains stay unchanged.

    Accuracy: that of the links; angles start in (-pi, pi] and are continuous from the first instant.
    """
    links, joints = {GROUND, *motion.links}, dict[str, JointMotion]()
    for joint in mechanism.joints:
        reported = {name: motion.joints[name] for name in joint.coordinates if name in motion.joints}
        if len(reported) < len(joint.coordinates) and {*joint.links} <= links:
            for name, coordinate in joint_motions(joint, motion.links).items():
                if coordinate.unit == "rad":
                    value = _with_revolutions(coordinate.value, coordinate.rate, motion.time)
                    coordinate = replace(coordinate, value=value)
                joints[name] = coordinate
        joints |= reported
    return replace(motion, joints=joints | {k: v for k, v in motion.joints.items() if k not in joints})


def point_on(link: LinkMotion, local: ArrayLike) -> PointMotion:
    """Return the motion of a point fixed in a moving link, (3,), or another at each instant, (n, 3)."""
    arm = rotated(link.rotation, np.asarray(local))
    tangential = cross(link.angular_velocity, arm)
    acceleration = cross(link.angular_acceleration, arm) + cross(link.angular_velocity, tangential)
    return PointMotion(link.position + arm, link.velocity + tangential, link.acceleration + acceleration)


def tracked_points(mechanism: Mechanism, links: Mapping[str, LinkMotion]) -> dict[str, PointMotion]:
    """Return the motions of the tracked points of moving links."""
    moving = ((name, *owner) for name, owner in mechanism.points.items() if owner[0] != GROUND)
    return {name: point_on(links[link], local) for name, link, local in moving}


def joint_motions(
    joint: Joint, links: Mapping[str, LinkMotion], sides: tuple[Array, Array] | None = None
) -> dict[str, JointMotion]:
    """Return the motion of each coordinate of a joint from those of its links; angles are in (-pi, pi].

    The frames of its sides are (3, 3), by default those of the joint, or (3, 3, n) of many designs.
    """
    kind = KINDS[joint.kind]
    angle_only = kind.hinge and not kind.slides
    a, b = (frame_of(link_or_ground_motion(end.link, links), angle_only) for end in (joint.a, joint.b))
    count = len(next(iter(links.values())).position)
    return motions_of_joint(joint, joint_coordinates(joint, a, b, sides), count)


def tree_joint_motions(
    tree: SpanningTree,
    joints: Sequence[Joint],
    links: Mapping[str, LinkMotion],
    values: tuple[Array, Array, Array],
) -> dict[str, JointMotion]:
    """Return the motion of each coordinate, for joints that close loops from the motion of their links.

    Args:
        tree: the tree with known coordinates.
        joints: joints of the mechanism.
        links: motions of its links.
        values: coordinates of the tree and their first and second derivatives, (count, n) each.
    """
    motions: dict[str, JointMotion] = {}
    for joint in joints:
        kind = KINDS[joint.kind]
        if joint.name not in tree.joint_names:
            for name, motion in joint_motions(joint, links).items():
                angle = motion.unit == "rad"
                motions[name] = replace(motion, value=unwrapped_angles(motion.value)) if angle else motion
            continue
        for i, (name, unit) in enumerate(zip(joint.coordinates, kind.units, strict=True)):
            value, rate, second = (rows[tree.index_of[name]] for rows in values)
            component = None if kind.single else i
            motions[name] = JointMotion(value, rate, second, "m" if unit == "m" else "rad", component)
    return motions


def link_or_ground_motion(name: str, links: Mapping[str, LinkMotion]) -> LinkMotion:
    """Return the motion of a link, or of the ground, which is at rest."""
    if name != GROUND:
        return links[name]
    zero = np.zeros_like(next(iter(links.values())).position)
    frames = np.broadcast_to(np.eye(3), (*zero.shape, 3))
    return LinkMotion(zero, frames, zero, zero, zero, zero)


def _with_revolutions(angle: Array, rate: Array, time: Array | None) -> Array:
    """Return angles with revolutions: each is nearest to the prediction from the one before and its rate."""
    predicted = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time) if time is not None else np.zeros(len(angle) - 1)
    step = np.diff(angle)
    step = step + REVOLUTION * np.round((predicted - step) / REVOLUTION)
    return angle[:1].repeat(len(angle)) + np.concatenate([[0.0], np.cumsum(step)])
