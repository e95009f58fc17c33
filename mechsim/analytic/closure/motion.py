"""Velocities and accelerations of everything, by the loop equations differentiated twice."""

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.closure.loop_equations import Poses, equations
from mechsim.analytic.closure.rank import least_norm
from mechsim.analytic.vector_method.rotations import cross, dot
from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.maths.complex_step import unwrapped
from mechsim.maths.given import numbers
from mechsim.model.joints import COLUMN, KINDS
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
            name: motion for joint in mechanism.joints for name, motion in joint_motions(joint, links).items()
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


def joint_motions(joint: Joint, links: Mapping[str, LinkMotion]) -> dict[str, JointMotion]:
    """Return the motion of each coordinate of a joint from those of its links; angles are unwrapped."""
    kind = KINDS[joint.kind]
    a, b = (_link_motion(end.link, links) for end in (joint.a, joint.b))
    values = joint_coordinate(joint, *(Pose(link.position, link.rotation) for link in (a, b)))
    slid, turned = _slides(joint, a, b), _turns(joint, a, b)
    motions: dict[str, JointMotion] = {}
    for i, (name, unit) in enumerate(zip(joint.coordinates, kind.units, strict=True)):
        part = None if kind.single else i
        if unit == "m":
            motions[name] = JointMotion(values[..., i], *next(slid), "m", part)
        else:
            motions[name] = JointMotion(unwrapped(values[..., i]), *next(turned), "rad", part)
    return motions


def _slides(joint: Joint, a: LinkMotion, b: LinkMotion) -> Iterator[tuple[Array, Array]]:
    """Yield first and second rate of each displacement, seen from link a, whose axes count it."""
    ends = point_on(a, joint.a.point), point_on(b, joint.b.point)
    gap = ends[1].position - ends[0].position
    seen = ends[1].velocity - ends[0].velocity - cross(a.angular_velocity, gap)
    second = ends[1].acceleration - ends[0].acceleration - cross(a.angular_acceleration, gap)
    second -= cross(a.angular_velocity, 2.0 * seen + cross(a.angular_velocity, gap))
    frame = a.rotation @ joint.a.frame
    for axis in KINDS[joint.kind].slides:
        along = frame[..., COLUMN[axis]]
        yield dot(along, seen), dot(along, second)


def _turns(joint: Joint, a: LinkMotion, b: LinkMotion) -> Iterator[tuple[Array, Array]]:
    """Yield first and second rate of each angle: links turn against each other about the joint's axes."""
    kind = KINDS[joint.kind]
    if kind.ball or not kind.turns:
        return
    spin = b.angular_velocity - a.angular_velocity
    turning = b.angular_acceleration - a.angular_acceleration
    axis = a.rotation @ np.asarray(joint.a.axis)
    if not kind.crossed:
        # a rate of the axis is square to it
        yield dot(axis, spin), dot(axis, turning)
        return
    other = b.rotation @ np.asarray(joint.b.axis)
    first = _along(axis, other, spin)
    swung = first[0][..., None] * cross(a.angular_velocity, axis)
    swung = swung + first[1][..., None] * cross(b.angular_velocity, other)
    yield from zip(first, _along(axis, other, turning - swung), strict=True)


def _along(axis: Array, other: Array, vector: Array) -> tuple[Array, Array]:
    """Return the parts of vectors, (..., 3), along two unit vectors that cross."""
    near, shares = dot(axis, other), (dot(axis, vector), dot(other, vector))
    across = 1.0 - near**2
    return (shares[0] - near * shares[1]) / across, (shares[1] - near * shares[0]) / across


def _link_motion(name: str, links: Mapping[str, LinkMotion]) -> LinkMotion:
    if name != GROUND:
        return links[name]
    still = np.zeros_like(next(iter(links.values())).position)
    frames = np.broadcast_to(np.eye(3), (*still.shape, 3))
    return LinkMotion(still, frames, still, still, still, still)
