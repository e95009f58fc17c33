"""Velocities and accelerations of everything, by the loop equations differentiated twice."""

import numpy as np
from numpy.typing import ArrayLike

from mechsim.analytic.loops.joint_motion import joint_motions, point_on
from mechsim.analytic.loops.loop_equations import Poses, equations
from mechsim.analytic.loops.rank import least_norm
from mechsim.errors import InputError
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import LinkMotion, Motion
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import numbers


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
    rhs = np.zeros_like(rows.residual)
    rhs[:, -1] = speed
    twist = least_norm(mechanism, rows.jacobian, rhs).reshape(n, -1, 6)
    twists = {name: twist[:, i] for i, name in enumerate(names)}

    rows = equations(mechanism, poses, angle, twists)
    rhs[:, -1] = acceleration
    accelerations = least_norm(mechanism, rows.jacobian, rhs - rows.bias).reshape(n, -1, 6)

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


def crank_rate(mechanism: Mechanism, what: str, value: ArrayLike, n: int) -> Array:
    """Return a rate of the crank at n instants, (n,), or say what is wrong with it."""
    rate = numbers(value)
    if rate.shape not in ((), (1,), (n,)) or not np.isfinite(rate).all():
        raise InputError(f"{mechanism.name}: the crank's {what} is no finite number; give one, or {n}, in SI")
    return np.broadcast_to(rate, (n,))
