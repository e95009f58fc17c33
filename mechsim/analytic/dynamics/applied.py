"""What acts on the links: forces and moments about link origins, in the ground frame.

All forces fall into parts by how they depend on the crank's speed w: static (gravity, springs),
damping (times w), Coulomb friction (times the sign of w), and loads with a course of their own.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.dynamics.friction import Dry, add_efforts, add_force, add_friction
from mechsim.analytic.dynamics.machines import Machine
from mechsim.analytic.dynamics.unit_motion import UnitMotion
from mechsim.analytic.vector_method.rotations import cross, dot, wrap
from mechsim.errors import InputError
from mechsim.model.forces import Spring
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import Joint, joint_coordinate
from mechsim.model.links import IDENTITY
from mechsim.numerics.arrays import Array

Stack = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Applied:
    """Wrenches on the links, (n, L, 6) in [N, N m] each, and the energy stored.

    Attributes:
        gravity: weight.
        springs: between points and in joints.
        damping: of viscous friction and dampers at unit crank speed.
        coulomb: of dry friction while the crank turns forwards.
        energy: of gravity (zero at the ground's origin) and springs, (n,) in [J].
        dry: each dry friction on its own.
    """

    gravity: Array
    springs: Array
    damping: Array
    coulomb: Array
    energy: Array
    dry: tuple[Dry, ...]

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
        _add_tension(unit, springs, spring, tension)
        _add_tension(unit, damping, spring, damper)
        energy = energy + stored
    for spring in forces.joint_springs:
        joint = unit.mechanism.joint(spring.joint)
        stretch = coordinate(unit, joint) - spring.rest
        if KINDS[joint.kind].hinge:
            stretch = wrap(stretch)
        add_efforts(unit, springs, joint, [-spring.stiffness * stretch])
        energy = energy + 0.5 * spring.stiffness * stretch**2
    rubbing: list[Dry] = []
    for friction in forces.friction:
        rubbing += add_friction(unit, damping, coulomb, friction)
    for what, part in (("a spring", springs), ("friction or a damper", damping), ("friction", coulomb)):
        require_idle(unit, part, what)
    return Applied(gravity, springs, damping, coulomb, energy, tuple(rubbing))


@dataclass(frozen=True, slots=True)
class Loads:
    """Loads with a course of their own.

    Attributes:
        wrenches: of loads on points and couples on links, (n, L, 6) in [N, N m].
        crank: torque on the crank itself, (n,) in [N m].
        torque: generalised force of both on the crank, (n,) in [N m].
    """

    wrenches: Array
    crank: Array
    torque: Array


def loads(machine: Machine, unit: UnitMotion, time: Array | None) -> Loads:
    """Return the loads at angles and times (n,) in [s]; None where the time is not known."""
    out = np.zeros_like(unit.twist)
    for load in machine.forces.loads:
        link, place, _ = unit.place(load.place)
        add_force(unit, out, link, place, load.force.at(unit.angle, time))
    for couple in machine.forces.couples:
        slot = unit.slot(couple.link)
        if slot is not None:
            out[:, slot, 3:] += couple.moment.at(unit.angle, time)
    require_idle(unit, out, "a load")
    course = machine.forces.crank_torque
    crank = np.zeros(len(unit)) if course is None else course.at(unit.angle, time)
    return Loads(out, crank, crank + power(unit, out))


def coordinate(unit: UnitMotion, joint: Joint) -> Array:
    """Return the one coordinate of a revolute or prismatic joint, (n,) in [rad] or [m]."""
    poses = unit.poses()
    a, b = (poses.get(end.link, IDENTITY) for end in (joint.a, joint.b))
    return joint_coordinate(joint, a, b)[..., 0]


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


def _add_tension(unit: UnitMotion, stack: Stack, spring: Spring, tension: Array) -> None:
    line, _, _ = _line(unit, spring)
    for place, sign in ((spring.a, 1.0), (spring.b, -1.0)):
        link, where, _ = unit.place(place)
        add_force(unit, stack, link, where, sign * tension[:, None] * line)
