"""What acts on the links: forces and moments about link origins, in the ground frame.

All forces fall into parts by how they depend on the crank's speed w: static (gravity, springs),
damping (times w), Coulomb friction (times the sign of w), and loads with a course of their own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.course import Course
from mechsim.dynamics.machine import Machine
from mechsim.dynamics.unit import UnitMotion, cross, dot
from mechsim.errors import InputError
from mechsim.forces import Friction, Spring
from mechsim.mechanism import IDENTITY, Array, Joint, joint_coordinate

Stack = NDArray[np.float64]

# a joint that moves less than this a radian of the crank, in [rad] or sizes of the mechanism, is where it
# turns round: the sign of its rate is rounding there, and dry friction has no direction
STILL = 1e-7


@dataclass(frozen=True, slots=True)
class Applied:
    """Wrenches on the links, (n, L, 6) in [N, N m] each, and the energy stored.

    Attributes:
        gravity: weight.
        springs: between points and in joints.
        damping: of viscous friction and dampers at unit crank speed.
        coulomb: of dry friction while the crank turns forwards.
        energy: of gravity (zero at the ground's origin) and springs, (n,) in [J].
    """

    gravity: Array
    springs: Array
    damping: Array
    coulomb: Array
    energy: Array

    def total(self, speed: Array) -> Array:
        """Return the sum at crank speeds (n,) in [rad/s]; a crank at rest has no Coulomb friction."""
        w, sign = speed[:, None, None], np.sign(speed)[:, None, None]
        return self.gravity + self.springs + w * self.damping + sign * self.coulomb


def applied(machine: Machine, unit: UnitMotion) -> Applied:
    """Return what acts on the links, loads, flywheel and motor apart.

    Raises:
        InputError: for forces that would spin a link whose spin nothing determines.
    """
    forces, nothing = machine.forces, np.zeros_like(unit.twist)
    weight = unit.masses[:, None] * np.asarray(forces.gravity)
    weight = np.broadcast_to(weight, unit.centres.shape)
    gravity = np.concatenate([weight, cross(unit.centres, weight)], -1)
    heights = (unit.position + unit.centres) @ np.asarray(forces.gravity)
    energy = -(heights * unit.masses).sum(-1)
    springs, damping, coulomb = nothing.copy(), nothing.copy(), nothing.copy()
    for spring in forces.springs:
        tension, damper, stored = _spring(unit, spring)
        _pull(unit, springs, spring, tension)
        _pull(unit, damping, spring, damper)
        energy = energy + stored
    for spring in forces.joint_springs:
        joint = unit.mechanism.joint(spring.joint)
        way = coordinate(unit, joint) - spring.rest
        if joint.kind == "revolute":
            way = way - 2.0 * np.pi * np.round(way / (2.0 * np.pi))
        add_joint_effort(unit, springs, joint, -spring.stiffness * way)
        energy = energy + 0.5 * spring.stiffness * way**2
    for friction in forces.friction:
        _add_friction(unit, damping, coulomb, friction)
    for what, part in (("a spring", springs), ("friction or a damper", damping), ("friction", coulomb)):
        require_idle(unit, part, what)
    return Applied(gravity, springs, damping, coulomb, energy)


def loads(machine: Machine, unit: UnitMotion, time: Array | None) -> Array:
    """Return the wrenches of the loads on points, (n, L, 6), at crank angles and times in [s]."""
    out = np.zeros_like(unit.twist)
    for load in machine.forces.loads:
        link, place, _ = unit.place(load.place)
        add_force(unit, out, link, place, load.force.at(unit.angle, time))
    require_idle(unit, out, "a load")
    return out


def course_at(course: Course | None, angle: Array, time: Array | None) -> Array:
    """Return a scalar course, or zeros where there is none, (n,)."""
    return np.zeros(len(angle)) if course is None else course.at(angle, time)


def coordinate(unit: UnitMotion, joint: Joint) -> Array:
    """Return the one coordinate of a revolute or prismatic joint, (n,) in [rad] or [m]."""
    poses = unit.poses()
    a, b = (poses.get(end.link, IDENTITY) for end in (joint.a, joint.b))
    return joint_coordinate(joint, a, b)[..., 0]


def joint_rate(unit: UnitMotion, joint: Joint) -> Array:
    """Return the derivative of a revolute or prismatic joint's coordinate by the crank angle, (n,)."""
    axis, spin_a = unit.axis(joint), unit.spin(joint.a.link)
    if joint.kind == "revolute":
        return dot(axis, unit.spin(joint.b.link) - spin_a)
    place_a, rate_a = unit.point(joint.a.link, joint.a.point)
    place_b, rate_b = unit.point(joint.b.link, joint.b.point)
    return dot(axis, rate_b - rate_a - cross(spin_a, place_b - place_a))


def turning_round(unit: UnitMotion, joint: Joint) -> NDArray[np.bool_]:
    """Return where a revolute or prismatic joint changes direction, (n,)."""
    least = STILL * (unit.mechanism.size if joint.kind == "prismatic" else 1.0)
    return np.abs(joint_rate(unit, joint)) <= least


def add_force(unit: UnitMotion, stack: Stack, link: str, place: Array, force: Array) -> None:
    """Add a force on a link at a place in the ground frame to a stack of wrenches."""
    slot = unit.slot(link)
    if slot is not None:
        stack[:, slot, :3] += force
        stack[:, slot, 3:] += cross(place - unit.position[:, slot], force)


def add_couple(unit: UnitMotion, stack: Stack, joint: Joint, couple: Array) -> None:
    """Add a couple on a joint's link b, and its reverse on link a."""
    for link, sign in ((joint.b.link, 1.0), (joint.a.link, -1.0)):
        slot = unit.slot(link)
        if slot is not None:
            stack[:, slot, 3:] += sign * couple


def add_joint_effort(unit: UnitMotion, stack: Stack, joint: Joint, effort: Array) -> None:
    """Add a torque or force on link b along the axis of a revolute or prismatic joint."""
    along = effort[:, None] * unit.axis(joint)
    if joint.kind == "revolute":
        add_couple(unit, stack, joint, along)
        return
    place, _ = unit.point(joint.b.link, joint.b.point)
    add_force(unit, stack, joint.b.link, place, along)
    add_force(unit, stack, joint.a.link, place, -along)


def power(unit: UnitMotion, wrenches: Array) -> Array:
    """Return the generalised force of wrenches on the crank: virtual power at unit speed, (n,) in [N m]."""
    return (wrenches * unit.twist).sum((1, 2))


def require_idle(unit: UnitMotion, wrenches: Array, what: str) -> None:
    """Raise InputError if wrenches do work on a spin that nothing determines."""
    if not unit.idle.shape[-1]:
        return
    size = unit.mechanism.size
    units = np.array([size] * 3 + [1.0] * 3)
    work = np.abs((wrenches[..., None] * unit.idle).sum((1, 2))).max()
    most = np.abs(wrenches * units).max() * np.abs(unit.idle / units[:, None]).max()
    if work > 1e-9 * most:
        raise InputError(
            f"{unit.mechanism.name}: {what} would spin a link whose spin nothing determines; "
            "keep it on the link's line, or give the link a guide"
        )


def _spring(unit: UnitMotion, spring: Spring) -> tuple[Array, Array, Array]:
    """Return tension of the spring, of its damper at unit crank speed, and energy, (n,) each."""
    line, length, rate = _line(unit, spring)
    stretch = length - spring.rest
    return spring.stiffness * stretch, spring.damping * dot(line, rate), 0.5 * spring.stiffness * stretch**2


def _line(unit: UnitMotion, spring: Spring) -> tuple[Array, Array, Array]:
    """Return the direction from a to b, zero where they meet, the distance, and the gap's derivative."""
    (_, a, rate_a), (_, b, rate_b) = unit.place(spring.a), unit.place(spring.b)
    gap = b - a
    length = np.sqrt(dot(gap, gap))
    safe = np.where(length > 0.0, length, 1.0)
    return gap / safe[:, None], length, rate_b - rate_a


def _pull(unit: UnitMotion, stack: Stack, spring: Spring, tension: Array) -> None:
    line, _, _ = _line(unit, spring)
    for place, sign in ((spring.a, 1.0), (spring.b, -1.0)):
        link, where, _ = unit.place(place)
        add_force(unit, stack, link, where, sign * tension[:, None] * line)


def _add_friction(unit: UnitMotion, damping: Stack, coulomb: Stack, friction: Friction) -> None:
    joint = unit.mechanism.joint(friction.joint)
    if joint.kind in ("revolute", "prismatic"):
        rate = joint_rate(unit, joint)
        add_joint_effort(unit, damping, joint, -friction.viscous * rate)
        sign = np.where(turning_round(unit, joint), 0.0, np.sign(rate))
        add_joint_effort(unit, coulomb, joint, -friction.coulomb * sign)
        return
    spin = unit.spin(joint.b.link) - unit.spin(joint.a.link)
    if joint.kind == "universal":
        spin = _per_axis(unit.axis(joint, "a"), unit.axis(joint, "b"), spin)
    add_couple(unit, damping, joint, -friction.viscous * spin)


def _per_axis(first: Array, second: Array, spin: Array) -> Array:
    """Return the vector in the plane of two axes whose components along them are the angles' rates.

    With spin = p first + q second, it does the same work as torques p about the first axis and q about
    the second.
    """
    c, p, q = dot(first, second), dot(first, spin), dot(second, spin)
    s2 = 1.0 - c**2
    rate1, rate2 = (p - c * q) / s2, (q - c * p) / s2
    x, y = (rate1 - c * rate2) / s2, (rate2 - c * rate1) / s2
    return x[:, None] * first + y[:, None] * second
