"""Inverse dynamics: what a machine needs, and what its joints carry, while its crank moves as prescribed."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.analytic.dynamics.applied import applied, course_at, loads
from mechsim.analytic.dynamics.friction import STILL, add_couple, dry
from mechsim.analytic.dynamics.machines import Machine
from mechsim.analytic.dynamics.reactions import COMPONENTS, Balance, balance
from mechsim.analytic.dynamics.reduced_equation import Reduced, coefficients, kinetic_energy, load_torque
from mechsim.analytic.dynamics.unit_motion import UnitMotion, cross
from mechsim.errors import InputError

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Study:
    """The dynamics of a machine at n instants, in SI; vectors in the ground frame.

    Attributes:
        machine: whose.
        angle: crank angle, (n,) in [rad].
        speed: of the crank, (n,) in [rad/s].
        acceleration: of the crank, (n,) in [rad/s2].
        time: (n,) in [s]; None where it is not known.
        torque: drive torque on the driven joint's link b about its axis, by virtual power, (n,) in
            [N m]. It includes what a flywheel takes, and replaces the motor.
        load: generalised force of the loads on the crank, (n,) in [N m].
        reduced: coefficients of the reduced equation.
        balance: drive torque by Newton and Euler (a second route), and all joint reactions.
        shaking_force: on the frame, by the whole machine, (n, 3) in [N].
        shaking_moment: likewise, about the ground's origin, (n, 3) in [N m].
        kinetic: energy of motion, link by link, flywheel included, (n,) in [J].
        potential: energy of gravity and springs, (n,) in [J].
        reversing: where a joint with dry friction turns round, or the crank with it, so that reactions
            jump from one value to another, (n,); those given are without this joint's dry friction,
            halfway between. Where the crank stands, so does the drive torque.
    """

    machine: Machine
    angle: Array
    speed: Array
    acceleration: Array
    time: Array | None
    torque: Array
    load: Array
    reduced: Reduced
    balance: Balance
    shaking_force: Array
    shaking_moment: Array
    kinetic: Array
    potential: Array
    reversing: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.angle)

    @property
    def power_in(self) -> Array:
        """Power of the drive, (n,) in [W]."""
        return self.torque * self.speed

    @property
    def power_loads(self) -> Array:
        """Power of the loads on the machine, (n,) in [W]."""
        return self.load * self.speed

    @property
    def power_lost(self) -> Array:
        """Power lost in friction and dampers, (n,) in [W], 0 or more."""
        part = self.reduced
        return part.damping * self.speed**2 + part.coulomb * np.abs(self.speed)

    @property
    def power_stored(self) -> Array:
        """Rate at which kinetic and potential energy grow, (n,) in [W], from J, J' and statics."""
        w, e, part = self.speed, self.acceleration, self.reduced
        return w * (part.inertia * e + 0.5 * part.slope * w**2 - part.static)

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield the study as columns of a table in SI."""
        if self.time is not None:
            yield "time", self.time
        yield "angle", self.angle
        yield "speed", self.speed
        yield "acceleration", self.acceleration
        yield "torque", self.torque
        yield "inertia", self.reduced.inertia
        yield "inertia_slope", self.reduced.slope
        yield "kinetic", self.kinetic
        yield "potential", self.potential
        yield "power_in", self.power_in
        yield "power_loads", self.power_loads
        yield "power_lost", self.power_lost
        yield "power_stored", self.power_stored
        for name, reaction in self.balance.reactions.items():
            values = np.concatenate([reaction.force, reaction.moment], 1)
            for part, column in zip(COMPONENTS, values.T, strict=True):
                yield f"{name}.{part}", column
        for name, torque in self.balance.gears.items():
            yield f"gear {name}", torque
        shaking = np.concatenate([self.shaking_force, self.shaking_moment], 1)
        for part, column in zip(COMPONENTS, shaking.T, strict=True):
            yield f"frame.{part}", column


def prescribed(
    machine: Machine,
    angles: ArrayLike,
    speed: ArrayLike,
    acceleration: ArrayLike = 0.0,
    *,
    time: ArrayLike | None = None,
) -> Study:
    """Return the drive torque and everything the joints carry at prescribed crank motion.

    A coupler whose spin nothing determines has no torque about its line and no momentum about it.

    Args:
        machine: the machine; its motor is left out.
        angles: crank angles, (n,) in [rad].
        speed: of the crank, scalar or (n,) in [rad/s].
        acceleration: of the crank, scalar or (n,) in [rad/s2].
        time: (n,) in [s]; None at constant speed counts it from crank angle zero.

    Raises:
        InputError: for rates that are not finite, or loads over time where no time is known.
        AssemblyError: where the loops do not close.
    """
    angle = np.atleast_1d(np.asarray(angles, dtype=np.float64))
    w, e = _rate("speed", speed, angle), _rate("acceleration", acceleration, angle)
    at = None if time is None else np.broadcast_to(np.asarray(time, dtype=np.float64), angle.shape)
    if at is None and np.ptp(w) == 0.0 and w[0] != 0.0 and not e.any():
        at = angle / w
    unit = machine.unit_motion(angle)
    acting, part = applied(machine, unit), coefficients(machine, unit)
    outside = loads(machine, unit, at)
    crank = course_at(machine.forces.crank_torque, angle, at) - machine.forces.flywheel * e
    inertial = unit.inertial(w, e)
    # the flywheel and the crank's own load act in the driven joint
    shared = np.zeros_like(inertial)
    driver = unit.mechanism.joint(unit.mechanism.driver)
    add_couple(unit, shared, driver, crank[:, None] * unit.axis(driver))
    load = load_torque(machine, unit, at)
    still = [part.still for one in machine.forces.friction for part in dry(unit, one)]
    force, moment = _shaking(machine, unit, inertial, acting.gravity + outside, e)
    return Study(
        machine,
        angle,
        w,
        e,
        at,
        part.torque(w, e) - load,
        load,
        part,
        balance(unit, inertial - acting.total(w) - outside - shared),
        force,
        moment,
        kinetic_energy(unit, w, machine.forces.flywheel),
        part.energy,
        _any([one | _standing(w) for one in still], len(angle)),
    )


def _shaking(
    machine: Machine, unit: UnitMotion, inertial: Array, outside: Array, acceleration: Array
) -> tuple[Array, Array]:
    """Return force and moment about the ground's origin that the frame feels: outside less inertial."""
    left = outside - inertial
    force = left[..., :3].sum(1)
    moment = (left[..., 3:] + cross(unit.position, left[..., :3])).sum(1)
    driver = unit.mechanism.joint(unit.mechanism.driver)
    turned = machine.forces.flywheel * acceleration[:, None] * unit.axis(driver)
    return force, moment - turned


def _standing(speed: Array) -> NDArray[np.bool_]:
    """Return where a crank that moves elsewhere stands, (n,)."""
    return np.abs(speed) <= STILL * np.abs(speed).max()


def _any(each: list[NDArray[np.bool_]], n: int) -> NDArray[np.bool_]:
    """Return where any of some conditions holds, (n,)."""
    out = np.zeros(n, dtype=np.bool_)
    for one in each:
        out |= one
    return out


def _rate(what: str, value: ArrayLike, angle: Array) -> Array:
    try:
        rate = np.broadcast_to(np.asarray(value, dtype=np.float64), angle.shape)
    except ValueError:
        rate = np.full(angle.shape, np.nan)
    if not np.isfinite(rate).all():
        raise InputError(f"crank {what} must be one finite number or {len(angle)} of them; give SI units")
    return rate
