"""Building link motions from component-first vectors: what the closed forms share."""

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.vector_method.vectors import cross, dot
from mechsim.model.mechanism import Vector
from mechsim.model.motion import LinkMotion, PointMotion

Array = NDArray[np.float64]
STILL = np.zeros((3, 1))


def vector(values: Array) -> Vector:
    """Return three numbers of an array as a plain tuple."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def point(position: Array, velocity: Array = STILL, acceleration: Array = STILL) -> PointMotion:
    """Return the motion of a point from (3, n) vectors; fields are (n, 3) views."""
    shape = position.shape
    return PointMotion(position.T, np.broadcast_to(velocity, shape).T, np.broadcast_to(acceleration, shape).T)


def link(origin: PointMotion, axes: tuple[Array, Array, Array], spin: Array, pull: Array) -> LinkMotion:
    """Return a link's motion from origin, three axes, angular velocity and acceleration, (3, n) each."""
    n = len(origin.position)
    rotation = np.empty((3, 3, n))
    for column, axis in enumerate(axes):
        rotation[:, column] = axis
    return LinkMotion(
        origin.position,
        np.moveaxis(rotation, -1, 0),
        origin.velocity,
        np.broadcast_to(spin, (3, n)).T,
        origin.acceleration,
        np.broadcast_to(pull, (3, n)).T,
    )


def pinned_link(origin: Array, ahead: Array, axis: Array, spin: Array, pull: Array) -> LinkMotion:
    """Return the motion of a link that turns about a fixed axis through its origin.

    Args:
        origin: (3, 1) in [m].
        ahead: the link's x axis, (3, n) unit vectors.
        axis: the link's z axis and axis of turning, (3, 1) unit vector.
        spin: angular velocity about it, (n,).
        pull: angular acceleration about it, (n,).
    """
    place = point(np.broadcast_to(origin, ahead.shape))
    return link(place, (ahead, cross(axis, ahead), axis), spin * axis, pull * axis)


def planar_link(origin: PointMotion, ahead: Array, spin: Array, pull: Array) -> LinkMotion:
    """Return the motion of a link that moves in the XY plane with its x axis along `ahead`, (3, n)."""
    ez = np.array([[0.0], [0.0], [1.0]])
    return link(origin, (ahead, cross(ez, ahead), ez), spin * ez, pull * ez)


def rocker_rates(
    axis: Array, arm: Array, rod: Array, driving_v: Array, driving_a: Array
) -> tuple[Array, Array]:
    """Return angular velocity and acceleration of a rocker pulled by a rod, (n,) each.

    Args:
        axis: the rocker's axis, (3, 1) unit vector.
        arm: from the rocker's pivot to the rod, (3, n).
        rod: from the driving point to the rocker's, (3, n).
        driving_v: velocity of the driving point, (3, n); `driving_a` its acceleration.

    Source: the loop |rod| = constant, differentiated once and twice by time.
    """
    across = cross(axis, arm)
    lever = dot(rod, across)
    spin = dot(rod, driving_v) / lever
    gap_v = spin * across - driving_v
    pull = (dot(rod, driving_a + spin**2 * arm) - dot(gap_v, gap_v)) / lever
    return spin, pull


def guided_spin(
    x: Array, x_v: Array, x_a: Array, pin: Array, guide: Array, crank_spin: Array, crank_pull: Array
) -> tuple[Array, Array]:
    """Return angular velocity and acceleration of a rod whose guide keeps its angle to a pin.

    Args:
        x: unit vector along the rod, and its first two rates `x_v`, `x_a`, (3, n).
        pin: unit vector of the pin, fixed in the crank, (3, n).
        guide: unit vector fixed in the rod, at a constant angle to the pin, (3, n).
        crank_spin: angular velocity of the crank, (3, n); `crank_pull` its acceleration.

    Source: (spin - crank_spin) . (guide x pin) = 0, the rate of paper 000, eq. (29), and its own rate.
    """
    normal = cross(guide, pin)
    bend = cross(x, x_v)
    roll = dot(crank_spin - bend, normal) / dot(x, normal)
    spin = bend + roll * x
    normal_v = cross(cross(spin, guide), pin) + cross(guide, cross(crank_spin, pin))
    bend_v = cross(x, x_a) + roll * x_v
    free = dot(crank_pull - bend_v, normal) - dot(spin - crank_spin, normal_v)
    return spin, bend_v + free / dot(x, normal) * x


def planar_turn(rod: Array, rod_v: Array, rod_a: Array) -> tuple[Array, Array]:
    """Return angular velocity and acceleration of a rod of constant length in the XY plane, (n,) each.

    Args:
        rod: from one end to the other, (3, n); `rod_v` and `rod_a` its first two rates.
    """
    length2 = rod[0] * rod[0] + rod[1] * rod[1]
    spin = (rod[0] * rod_v[1] - rod[1] * rod_v[0]) / length2
    return spin, (rod[0] * rod_a[1] - rod[1] * rod_a[0]) / length2
