"""Velocities and accelerations of everything, by the loop equations differentiated twice."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.closure.loop_equations import Poses, equations
from mechsim.analytic.closure.rank import least_norm
from mechsim.analytic.vector_method.rotations import cross, dot
from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.maths.complex_step import unwrapped
from mechsim.maths.given import numbers
from mechsim.model.joints import KINDS
from mechsim.model.mechanism import GROUND, Joint, Mechanism, Pose, joint_coordinate
from mechsim.model.motion import JointMotion, LinkMotion, Motion, PointMotion


def rates(
    mechanism: Mechanism, poses: Poses, angle: ArrayLike, speed: ArrayLike, acceleration: ArrayLike = 0.0
) -> Motion:
    """Differentiate the loop equations twice: exact velocities and accelerations of everything.

    Args:
        mechanism: the mechanism.
        poses: moving link -> n poses that close the loops.
        angle: crank angle, (n,) in [rad].
        speed: crank speed, scalar or (n,) in [rad/s].
        acceleration: crank acceleration, scalar or (n,) in [rad/s2].

    Returns:
        The motion. Passive freedoms (the spin of an unguided coupler) get the least rates that agree.

    Accuracy: relative error about 1e-15 times the condition of the loop Jacobian.
    """
    names = [link.name for link in mechanism.links]
    angle = np.atleast_1d(np.asarray(angle, dtype=np.float64))
    n = len(angle)
    speed = crank_rate(mechanism, "speed", speed, n)
    acceleration = crank_rate(mechanism, "acceleration", acceleration, n)

    rows = equations(mechanism, poses, angle)
    asked = np.zeros_like(rows.residual)
    asked[:, -1] = speed
    twist = least_norm(mechanism, rows.jacobian, asked).reshape(n, -1, 6)
    twists = {name: twist[:, i] for i, name in enumerate(names)}

    rows = equations(mechanism, poses, angle, twists)
    asked[:, -1] = acceleration
    accelerations = least_norm(mechanism, rows.jacobian, asked - rows.bias).reshape(n, -1, 6)

    links = {
        name: LinkMotion(
            poses[name].position,
            poses[name].rotation,
            twist[:, i, :3],
            twist[:, i, 3:],
            accelerations[:, i, :3],
            accelerations[:, i, 3:],
        )
        for i, name in enumerate(names)
    }
    points = {
        point: point_on(links[link], local)
        for point, (link, local) in mechanism.points.items()
        if link != GROUND
    }
    return Motion(
        source="loop equations",
        angle=angle,
        speed=speed,
        acceleration=acceleration,
        points=points,
        links=links,
        joints={
            joint.name: joint_motion(joint, links) for joint in mechanism.joints if KINDS[joint.kind].single
        },
    )


def point_on(link: LinkMotion, local: ArrayLike) -> PointMotion:
    """Return the motion of a point fixed in a moving link."""
    arm = link.rotation @ np.asarray(local)
    swing = cross(link.angular_velocity, arm)
    bend = cross(link.angular_acceleration, arm) + cross(link.angular_velocity, swing)
    return PointMotion(link.position + arm, link.velocity + swing, link.acceleration + bend)


def crank_rate(mechanism: Mechanism, what: str, value: ArrayLike, n: int) -> Array:
    """Return a rate of the crank at n instants, (n,), or say what is wrong with it."""
    rate = numbers(value)
    if rate.shape not in ((), (1,), (n,)) or not np.isfinite(rate).all():
        raise InputError(f"{mechanism.name}: the crank's {what} is no finite number; give one, or {n}, in SI")
    return np.broadcast_to(rate, (n,))


def joint_motion(joint: Joint, links: Mapping[str, LinkMotion]) -> JointMotion:
    """Return the motion of a joint of one freedom from those of its links; angles are unwrapped."""
    a, b = (_link_motion(end.link, links) for end in (joint.a, joint.b))
    poses = [Pose(link.position, link.rotation) for link in (a, b)]
    value = joint_coordinate(joint, *poses)[..., 0]
    axis = a.rotation @ np.asarray(joint.a.axis)
    if KINDS[joint.kind].hinge:
        # the links turn against each other about the axis, which a rate of the axis is square to
        spin = b.angular_velocity - a.angular_velocity
        return JointMotion(
            unwrapped(value), dot(axis, spin), dot(axis, b.angular_acceleration - a.angular_acceleration)
        )
    ends = point_on(a, joint.a.point), point_on(b, joint.b.point)
    gap = ends[1].position - ends[0].position
    gap_rate = ends[1].velocity - ends[0].velocity
    gap_second = ends[1].acceleration - ends[0].acceleration
    axis_rate = cross(a.angular_velocity, axis)
    axis_second = cross(a.angular_acceleration, axis) + cross(a.angular_velocity, axis_rate)
    # the gap lies along the axis, which a rate of the axis is square to
    return JointMotion(
        value,
        dot(axis, gap_rate),
        dot(axis, gap_second) + 2.0 * dot(axis_rate, gap_rate) + dot(axis_second, gap),
        "m",
    )


def _link_motion(name: str, links: Mapping[str, LinkMotion]) -> LinkMotion:
    if name != GROUND:
        return links[name]
    still = np.zeros_like(next(iter(links.values())).position)
    frames = np.broadcast_to(np.eye(3), (*still.shape, 3))
    return LinkMotion(still, frames, still, still, still, still)
