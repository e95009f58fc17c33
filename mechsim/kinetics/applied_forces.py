"""Applied forces on the links: forces and moments about link origins, in the ground frame.

Forces are separated by their dependence on the crank speed w: static (gravity, springs), damping (times w),
Coulomb friction (times the sign of w), and loads that depend on crank angle or time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import InputError
from mechsim.kinematics.vector_method.rotations import dot, rotation_vector
from mechsim.kinetics.model import DynamicModel
from mechsim.kinetics.unit_motion import UnitMotion
from mechsim.mechanism.actuators import no_control
from mechsim.mechanism.forces import Friction, Location
from mechsim.mechanism.joint_kinds import COLUMN, KINDS
from mechsim.mechanism.joints import Joint, joint_coordinate
from mechsim.mechanism.nonlinear_springs import Bushing, NonlinearSpring, Phases
from mechsim.numerics.arrays import Array, cross, wrapped

# joint rate per radian of the crank, in [rad] or characteristic lengths, at or below which the joint
# reverses: the sign of its rate is rounding, and Coulomb friction has no direction
STILL = 1e-7


@dataclass(frozen=True, slots=True)
class Dry:
    """Coulomb friction: its magnitude in [N m] or [N], and the opposed rate (n,) per radian of the crank."""

    magnitude: float | Array
    rate: Array
    still: NDArray[np.bool_]

    @property
    def direction(self) -> Array:
        """Sign of the rate, (n,); 0 where the joint reverses."""
        return np.where(self.still, 0.0, np.sign(np.real(self.rate)))


def joint_rates(unit: UnitMotion, joint: Joint) -> list[Array]:
    """Return a joint's coordinate derivatives by crank angle; for a ball, the relative spin's magnitude."""
    kind, spin = KINDS[joint.kind], _spin(unit, joint)
    place_a, rate_a = unit.point(joint.a.link, joint.a.point)
    place_b, rate_b = unit.point(joint.b.link, joint.b.point)
    gap_rate = rate_b - rate_a - cross(unit.spin(joint.a.link), place_b - place_a)
    slide_rates = [dot(axis, gap_rate) for axis in _slides(unit, joint)]
    if kind.ball:
        return [*slide_rates, np.sqrt(dot(spin, spin))]
    if kind.crossed:
        axes = unit.axis(joint, "a"), unit.axis(joint, "b")
        return [*slide_rates, *_components(*axes, *(dot(axis, spin) for axis in axes))]
    return [*slide_rates, dot(unit.axis(joint), spin)] if kind.turns else slide_rates


def add_friction(unit: UnitMotion, damping: Array, coulomb: Array, friction: Friction) -> list[Dry]:
    """Add a joint's friction to wrenches: viscous at unit crank speed, Coulomb for forward crank motion.

    Returns:
        The nonzero Coulomb frictions; a spherical joint's rate is the magnitude of its relative spin.
    """
    joint = unit.mechanism.joint(friction.joint)
    rates, sizes = joint_rates(unit, joint), friction.sizes(KINDS[joint.kind])
    viscous = [-damper * rate for (damper, _), rate in zip(sizes, rates, strict=True)]
    dry = [dry_friction(unit, joint, rates, i, magnitude) for i, (_, magnitude) in enumerate(sizes)]
    add_joint_forces(unit, damping, joint, viscous)
    add_joint_forces(unit, coulomb, joint, [-each.magnitude * each.direction for each in dry])
    return [each for each in dry if each.magnitude]


def dry_friction(
    unit: UnitMotion, joint: Joint, rates: Sequence[Array], index: int, magnitude: float = 0.0
) -> Dry:
    """Return the Coulomb friction of a joint's coordinate, with the rates of all its coordinates."""
    slides = index < len(KINDS[joint.kind].slides)
    length = unit.mechanism.characteristic_length if slides else 1.0
    return Dry(magnitude, rates[index], np.abs(rates[index]) <= STILL * length)


def add_joint_forces(unit: UnitMotion, stack: Array, joint: Joint, forces: Sequence[Array]) -> None:
    """Add forces and torques (n,) on link b along a joint's coordinates; each does work on its own only.

    The torque of a ball acts about its relative spin.
    """
    kind = KINDS[joint.kind]
    for axis, effort in zip(_slides(unit, joint), forces, strict=False):
        force = effort[:, None] * axis
        point, _ = unit.point(joint.b.link, joint.b.point)
        add_force(unit, stack, joint.b.link, point, force)
        add_force(unit, stack, joint.a.link, point, -force)
    torques = forces[len(kind.slides) :]
    if not torques:
        return
    if kind.ball:
        spin = _spin(unit, joint)
        speed = np.sqrt(dot(spin, spin))
        couple = torques[0][:, None] * spin / np.where(speed != 0.0, speed, 1.0)[:, None]
        add_couple(unit, stack, joint, couple)
    elif kind.crossed:
        first, second = unit.axis(joint, "a"), unit.axis(joint, "b")
        x, y = _components(first, second, *torques)
        add_couple(unit, stack, joint, x[:, None] * first + y[:, None] * second)
    elif kind.turns:
        add_couple(unit, stack, joint, torques[0][:, None] * unit.axis(joint))


def add_joint_force(unit: UnitMotion, stack: Array, joint: Joint, index: int, force: Array) -> None:
    """Add a force or torque (n,) along one of a joint's coordinates, as `add_joint_forces` adds all."""
    kind = KINDS[joint.kind]
    count = len(kind.slides) + (1 if kind.ball else len(kind.turns))
    add_joint_forces(unit, stack, joint, [force * (i == index) for i in range(count)])


def add_force(unit: UnitMotion, stack: Array, link: str, point: Array, force: Array) -> None:
    """Add a force on a link, applied at a point in the ground frame, to a stack of wrenches."""
    slot = unit.slot(link)
    if slot is not None:
        stack[:, slot, :3] += force
        stack[:, slot, 3:] += cross(point - unit.position[:, slot], force)


def add_couple(unit: UnitMotion, stack: Array, joint: Joint | Bushing, couple: Array) -> None:
    """Add a couple on link b of a joint or bushing, and the opposite couple on link a."""
    for link, sign in ((joint.b.link, 1.0), (joint.a.link, -1.0)):
        slot = unit.slot(link)
        if slot is not None:
            stack[:, slot, 3:] += sign * couple


def _slides(unit: UnitMotion, joint: Joint) -> list[Array]:
    """Return the sliding directions of a joint, (n, 3) each."""
    return [unit.direction(joint.a, COLUMN[axis]) for axis in KINDS[joint.kind].slides]


def _spin(unit: UnitMotion, joint: Joint) -> Array:
    """Return the spin of a joint's link b relative to its link a, (n, 3)."""
    return unit.spin(joint.b.link) - unit.spin(joint.a.link)


def _components(first: Array, second: Array, p: Array, q: Array) -> tuple[Array, Array]:
    """Return x and y of the vector x first + y second that has the products p and q with two axes."""
    c = dot(first, second)
    s2 = 1.0 - c**2
    return (p - c * q) / s2, (q - c * p) / s2


Ends = tuple[Location, Location]


@dataclass(frozen=True, slots=True)
class Applied:
    """Wrenches on the links, (n, L, 6) in [N, N m] each, and the stored energy.

    Attributes:
        gravity: wrenches of weight.
        springs: wrenches of springs between points and in joints.
        damping: wrenches of viscous friction and dampers at unit crank speed.
        coulomb: wrenches of Coulomb friction for forward crank motion.
        energy: potential energy of gravity (zero at the ground's origin) and springs, (n,) in [J].
        dry: Coulomb frictions.
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


def applied(model: DynamicModel, unit: UnitMotion) -> Applied:
    """Return the applied forces on the links, without loads, flywheel and motor.

    Raises:
        InputError: for forces that do work on an undetermined spin of a link.
    """
    forces = model.forces
    weight = unit.masses[:, None] * np.asarray(forces.gravity)
    weight = np.broadcast_to(weight, unit.centres.shape)
    gravity = np.concatenate([weight, cross(unit.centres, weight)], -1)
    heights = (unit.position + unit.centres) @ np.asarray(forces.gravity)
    energy = -(heights * unit.masses).sum(-1)
    springs, damping, coulomb = (np.zeros_like(unit.twist) for _ in range(3))
    for spring in forces.springs:
        ends = spring.a, spring.b
        length, rate = distance_and_rate(unit, ends)
        stretch = length - spring.rest
        add_tension(unit, springs, ends, spring.stiffness * stretch)
        add_tension(unit, damping, ends, spring.damping * rate)
        energy = energy + 0.5 * spring.stiffness * stretch**2
    for spring in forces.joint_springs:
        joint = unit.mechanism.joint(spring.joint)
        stretch = _coordinate(unit, joint, 0, spring.rest) - spring.rest
        add_joint_forces(unit, springs, joint, [-spring.stiffness * stretch])
        energy = energy + 0.5 * spring.stiffness * stretch**2
    for bushing in forces.bushings:
        energy = energy + _add_bushing(unit, springs, damping, bushing)
    rubbing: list[Dry] = []
    for friction in forces.friction:
        rubbing += add_friction(unit, damping, coulomb, friction)
    for what, wrenches in (("a spring", springs), ("friction or a damper", damping), ("friction", coulomb)):
        require_idle(unit, wrenches, what)
    return Applied(gravity, springs, damping, coulomb, energy, tuple(rubbing))


@dataclass(frozen=True, slots=True)
class Loads:
    """Loads that depend on crank angle, crank speed or time.

    Attributes:
        wrenches: wrenches of loads, couples and nonlinear springs, (n, L, 6) in [N, N m].
        crank: torque on the crank itself, (n,) in [N m].
        torque: generalised force of both on the crank, (n,) in [N m].
        energy: energy stored in nonlinear springs, (n,) in [J].
        work: power of the loads, (n,) in [W].
        lost: power lost in nonlinear springs, (n,) in [W].
    """

    wrenches: Array
    crank: Array
    torque: Array
    energy: Array
    work: Array
    lost: Array


def loads(
    model: DynamicModel,
    unit: UnitMotion,
    time: Array | None,
    speed: Array | float = 1.0,
    phases: Phases | None = None,
) -> Loads:
    """Return the loads at crank angles.

    Args:
        model: with the loads among its forces.
        unit: motion per radian of the crank, or by time with a speed of 1.
        time: times (n,) in [s]; None if unknown.
        speed: crank speed in [rad/s].
        phases: phase of each nonlinear spring; None for those of its length and rate.
    """
    out = np.zeros_like(unit.twist)
    for load in model.forces.loads:
        link, point, _ = unit.locate(load.location)
        add_force(unit, out, link, point, load.force.evaluate(unit.angle, time))
    for couple in model.forces.couples:
        slot = unit.slot(couple.link)
        if slot is not None:
            out[:, slot, 3:] += couple.moment.evaluate(unit.angle, time)
    work, energy, lost = power(unit, out) * speed, np.zeros(len(unit)), np.zeros(len(unit))
    for k, spring in enumerate(model.forces.nonlinear_springs):
        length, rate = length_and_rate(unit, spring)
        phase, rate = None if phases is None else phases[k], rate * speed
        tension, elastic = spring.law.tension(length, rate, phase), spring.law.elastic(length, phase)
        if phases is None and (beyond := spring.law.beyond(length, rate)):
            raise InputError(f"{unit.mechanism.name}: {beyond}; extend the table")
        unstored = spring.law.unstored(length)
        if isinstance(spring.ends, str):
            add_joint_force(unit, out, *unit.mechanism.joint_with(spring.ends), -tension)
        else:
            add_tension(unit, out, spring.ends, tension)
        energy, work = energy + spring.law.energy(length), work - unstored * rate
        lost = lost + (tension - elastic - unstored) * rate
    require_idle(unit, out, "a load")
    course = model.forces.crank_torque
    crank = np.zeros(len(unit)) if course is None else course.evaluate(unit.angle, time)
    return Loads(out, crank, crank + power(unit, out), energy, work, lost)


def motor_wrenches(model: DynamicModel, unit: UnitMotion, time: Array | None, speed: Array) -> Array:
    """Return the wrenches of actuators besides the drivers', (n, L, 6), at times and crank speeds (n,)."""
    out, mechanism = np.zeros_like(unit.twist), unit.mechanism
    for actuator in model.forces.under_drivers({*mechanism.drivers, *mechanism.locked}).actuators:
        if time is None and actuator.control is not no_control:
            raise InputError(f"motor {actuator.name} needs times, and only crank angles are known; give them")
        none = np.zeros(len(unit))
        inputs = actuator.input(none if time is None else time)
        ends = {name: (ratio, *mechanism.joint_with(name)) for name, ratio in actuator.gear.items()}
        if actuator.ends:
            length, rate = (actuator.pull * each for each in distance_and_rate(unit, actuator.ends))
        else:
            length = sum(
                (ratio * _coordinate(unit, joint, k, 0.0) for ratio, joint, k in ends.values()), none
            )
            rate = sum((ratio * joint_rates(unit, joint)[k] for ratio, joint, k in ends.values()), none)
        force = actuator.force(inputs, length, rate * speed, none)
        if actuator.ends:
            add_tension(unit, out, actuator.ends, -actuator.pull * force)
        for ratio, joint, k in ends.values():
            add_joint_force(unit, out, joint, k, ratio * force)
    require_idle(unit, out, "a motor")
    return out


def length_and_rate(unit: UnitMotion, spring: NonlinearSpring) -> tuple[Array, Array]:
    """Return the length of a nonlinear spring and its rate at unit speed, (n,) each."""
    if not isinstance(spring.ends, str):
        return distance_and_rate(unit, spring.ends)
    joint, k = unit.mechanism.joint_with(spring.ends)
    return _coordinate(unit, joint, k, spring.law.reference), joint_rates(unit, joint)[k]


def _coordinate(unit: UnitMotion, joint: Joint, k: int, rest: float) -> Array:
    """Return a joint's coordinate in [m] or [rad]; an angle that is not counted is the one next to rest."""
    continuous = unit.coordinates.get(joint.coordinates[k])
    if continuous is not None and np.iscomplexobj(continuous):
        return continuous
    value: Any = _joint_values(unit, joint)[..., k]
    if continuous is not None:
        # dimensions may have complex steps that continuous values lack
        return continuous + 1j * np.imag(value) if np.iscomplexobj(value) else continuous
    return rest + wrapped(value - rest) if KINDS[joint.kind].units[k] == "rad" else value


def _joint_values(unit: UnitMotion, joint: Joint) -> Array:
    """Return the coordinates of a joint, (n, k) in [m] or [rad], angles within (-pi, pi]."""
    return joint_coordinate(joint, unit.pose(joint.a.link), unit.pose(joint.b.link))


def power(unit: UnitMotion, wrenches: Array) -> Array:
    """Return the generalised force of wrenches on the crank, (n,) in [N m]: virtual power at unit speed."""
    return (wrenches * unit.twist).sum((1, 2))


def require_idle(unit: UnitMotion, wrenches: Array, what: str) -> None:
    """Raise InputError if wrenches do work on an undetermined spin."""
    if not unit.idle.shape[-1]:
        return
    length = unit.mechanism.characteristic_length
    units = np.array([length] * 3 + [1.0] * 3)
    work = np.abs((wrenches[..., None] * unit.idle).sum((1, 2))).max()
    most = np.abs(wrenches * units).max() * np.abs(unit.idle / units[:, None]).max()
    if work > 1e-9 * most:
        raise InputError(
            f"{unit.mechanism.name}: {what} acts about the axis of a passive rotation, which no "
            "joint resists; keep it on the link's line, or give the link a guide"
        )


def _add_bushing(unit: UnitMotion, springs: Array, damping: Array, bushing: Bushing) -> Array:
    """Add a bushing's wrenches, and those of its damping at unit crank speed; return its energy, (n,)."""
    frame_a, frame_b = (
        np.stack([unit.direction(end, column) for column in range(3)], -1) for end in (bushing.a, bushing.b)
    )
    (at_a, rate_a), (at_b, rate_b) = (unit.point(end.link, end.point) for end in (bushing.a, bushing.b))
    into_a, carried = np.swapaxes(frame_a, -1, -2), unit.spin(bushing.a.link)
    rotated, factor = rotation_vector(into_a @ frame_b)
    gap = at_b - at_a
    moved, rate, spin = (
        (into_a @ vector[..., None])[..., 0]
        for vector in (gap, rate_b - rate_a - cross(carried, gap), unit.spin(bushing.b.link) - carried)
    )
    stiffness, damper = bushing.matrices
    deflection = np.concatenate([moved, rotated], -1)
    elastic, damped = -deflection @ stiffness, -np.concatenate([rate, spin], -1) @ damper
    energy = -0.5 * (elastic * deflection).sum(-1)
    across = cross(rotated, elastic[:, 3:])
    elastic[:, 3:] += 0.5 * across + factor[:, None] * cross(rotated, across)
    for stack, wrench in ((springs, elastic), (damping, damped)):
        force, moment = ((frame_a @ half[..., None])[..., 0] for half in (wrench[:, :3], wrench[:, 3:]))
        add_force(unit, stack, bushing.b.link, at_b, force)
        add_force(unit, stack, bushing.a.link, at_b, -force)
        add_couple(unit, stack, bushing, moment)
    return energy


def distance_and_rate(unit: UnitMotion, ends: Ends) -> tuple[Array, Array]:
    """Return the distance of two points and its rate at unit speed, (n,) each."""
    line, length, rate = _line(unit, ends)
    return length, dot(line, rate)


def _line(unit: UnitMotion, ends: Ends) -> tuple[Array, Array, Array]:
    """Return the direction from a to b (zero if equal), the distance, and the derivative of b - a."""
    (_, a, rate_a), (_, b, rate_b) = (unit.locate(end) for end in ends)
    gap = b - a
    length = np.sqrt(dot(gap, gap))
    safe = np.where(length > 0.0, length, 1.0)
    return gap / safe[:, None], length, rate_b - rate_a


def add_tension(unit: UnitMotion, stack: Array, ends: Ends, tension: Array) -> None:
    """Add the forces of a tension (n,) between two points to a stack of wrenches."""
    line, _, _ = _line(unit, ends)
    for location, sign in zip(ends, (1.0, -1.0), strict=True):
        link, where, _ = unit.locate(location)
        add_force(unit, stack, link, where, sign * tension[:, None] * line)
