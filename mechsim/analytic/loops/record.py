"""Joint coordinates and positions of points, with their rates, from the motion of links."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.loops.tree import SpanningTree
from mechsim.analytic.vector_method.rotations import dot
from mechsim.model.joint_kinds import COLUMN, KINDS
from mechsim.model.joints import Joint, joint_coordinate
from mechsim.model.link_poses import rotated
from mechsim.model.links import GROUND, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import JointMotion, LinkMotion, Motion, PointMotion
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array, cross
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
        if len(reported) < len(joint.coordinates) and {joint.a.link, joint.b.link} <= links:
            for name, coordinate in joint_motions(joint, motion.links).items():
                value = (
                    _with_revolutions(coordinate.value, coordinate.rate, motion.time)
                    if coordinate.unit == "rad"
                    else coordinate.value
                )
                joints[name] = replace(coordinate, value=value)
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


def joint_motions(joint: Joint, links: Mapping[str, LinkMotion]) -> dict[str, JointMotion]:
    """Return the motion of each coordinate of a joint from those of its links; angles are unwrapped."""
    kind = KINDS[joint.kind]
    a, b = (link_or_ground_motion(end.link, links) for end in (joint.a, joint.b))
    values = joint_coordinate(joint, *(Pose(link.position, link.rotation) for link in (a, b)))
    translations, angles = _slides(joint, a, b), _turns(joint, a, b)
    motions: dict[str, JointMotion] = {}
    for i, (name, unit) in enumerate(zip(joint.coordinates, kind.units, strict=True)):
        index = None if kind.single else i
        if unit == "m":
            motions[name] = JointMotion(values[..., i], *next(translations), "m", index)
        else:
            motions[name] = JointMotion(unwrapped_angles(values[..., i]), *next(angles), "rad", index)
    return motions


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
        if tree.first_index(joint.name) is None:
            motions |= joint_motions(joint, links)
            continue
        for i, (name, unit) in enumerate(zip(joint.coordinates, kind.units, strict=True)):
            value, rate, second = (rows[tree.index_of[name]] for rows in values)
            component = None if kind.single else i
            motions[name] = JointMotion(value, rate, second, "m" if unit == "m" else "rad", component)
    return motions


def _slides(joint: Joint, a: LinkMotion, b: LinkMotion) -> Iterator[tuple[Array, Array]]:
    """Yield first and second derivative of each displacement, along the axes of link a."""
    ends = point_on(a, joint.a.point), point_on(b, joint.b.point)
    gap = ends[1].position - ends[0].position
    relative = ends[1].velocity - ends[0].velocity - cross(a.angular_velocity, gap)
    second = ends[1].acceleration - ends[0].acceleration - cross(a.angular_acceleration, gap)
    second -= cross(a.angular_velocity, 2.0 * relative + cross(a.angular_velocity, gap))
    frame = a.rotation @ joint.a.frame
    for axis in KINDS[joint.kind].slides:
        along = frame[..., COLUMN[axis]]
        yield dot(along, relative), dot(along, second)


def _turns(joint: Joint, a: LinkMotion, b: LinkMotion) -> Iterator[tuple[Array, Array]]:
    """Yield first and second derivative of each angle: relative rotation about the joint's axes."""
    kind = KINDS[joint.kind]
    if kind.ball or not kind.turns:
        return
    angular_velocity = b.angular_velocity - a.angular_velocity
    angular_acceleration = b.angular_acceleration - a.angular_acceleration
    axis = a.rotation @ np.asarray(joint.a.axis)
    if not kind.crossed:
        # a rate of the axis is perpendicular to it
        yield dot(axis, angular_velocity), dot(axis, angular_acceleration)
        return
    other = b.rotation @ np.asarray(joint.b.axis)
    first = _along(axis, other, angular_velocity)
    transport = first[0][..., None] * cross(a.angular_velocity, axis)
    transport = transport + first[1][..., None] * cross(b.angular_velocity, other)
    yield from zip(first, _along(axis, other, angular_acceleration - transport), strict=True)


def _along(axis: Array, other: Array, vector: Array) -> tuple[Array, Array]:
    """Return the components of vectors, (..., 3), along two crossing unit vectors."""
    cosine, components = dot(axis, other), (dot(axis, vector), dot(other, vector))
    sine_squared = 1.0 - cosine**2
    return (components[0] - cosine * components[1]) / sine_squared, (
        components[1] - cosine * components[0]
    ) / sine_squared


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
