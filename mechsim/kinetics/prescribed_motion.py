"""Inverse dynamics: drive forces and joint reactions for a prescribed motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import InputError
from mechsim.kinematics.path_instants import PathInstants, crank_motion, path_instants
from mechsim.kinetics.applied_forces import (
    STILL,
    Dry,
    add_couple,
    add_joint_forces,
    applied,
    loads,
    motor_wrenches,
    power,
)
from mechsim.kinetics.load_friction import with_load_friction
from mechsim.kinetics.model import DynamicModel
from mechsim.kinetics.reactions import balance
from mechsim.kinetics.reduced_equation import Reduced, kinetic_energy_of_links, reduced_coefficients
from mechsim.kinetics.unit_motion import UnitMotion
from mechsim.mechanism.force_record import ForceRecord, Reaction, wrench_columns
from mechsim.mechanism.masses import LinkMass
from mechsim.mechanism.motion import Motion, join, select_instants, short_repr
from mechsim.numerics.arrays import Array, cross, require
from mechsim.numerics.resources import Progress, no_progress, require_memory

# number of instants solved together, at most, and products of these and the number of links: 200 MB
BATCH_SIZE, BATCH_LINKS = 4096, 49152
# numbers stored per instant, and per joint and instant; each exists twice while chunks are merged
NUMBERS_PER_INSTANT, NUMBERS_PER_JOINT, COPIES = 40.0, 27.0, 16.0
FEWER = "take {most} instants at the most"


@dataclass(frozen=True, slots=True, kw_only=True)
class InverseDynamics:
    """Analytic inverse dynamics for a prescribed motion at n instants, in SI and the ground frame.

    Attributes:
        model: the dynamic model.
        forces: the record that both methods compute; the drive torque is by virtual power and replaces the
            motor. Where Coulomb friction reverses, reactions are without it, halfway between two values.
        load: generalised force of the loads, and of motors besides the drive, on the crank, (n,) in [N m].
        reduced: coefficients of the reduced equation.
        second_torque: the drive torque by the Newton-Euler equations, an independent method, (n,) in [N m].
        indeterminacy: number of independent self-stresses: joint forces in balance without any load.
        shaking_force: force of the whole mechanism on the frame, (n, 3) in [N].
        shaking_moment: its moment about the ground's origin, (n, 3) in [N m].
    """

    model: DynamicModel
    forces: ForceRecord
    load: Array
    reduced: Reduced
    second_torque: Array
    indeterminacy: int
    shaking_force: Array
    shaking_moment: Array

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.forces)

    @property
    def masses(self) -> tuple[LinkMass, ...]:
        """The masses of the links and their sources."""
        return self.model.masses

    @property
    def torque_parts(self) -> dict[str, Array]:
        """Components of the drive torque, (n,) each in [N m]."""
        reduced, w = self.reduced, self.forces.speed
        return {
            "inertia": reduced.inertia * self.forces.acceleration + 0.5 * reduced.inertia_derivative * w**2,
            "weight and springs": -reduced.static,
            "friction": reduced.damping * w + reduced.coulomb * np.sign(w),
            "loads": -self.load,
        }

    @property
    def power_stored(self) -> Array:
        """Rate of kinetic and potential energy, (n,) in [W], from J, J' and static forces."""
        w, e, reduced = self.forces.speed, self.forces.acceleration, self.reduced
        return w * (reduced.inertia * e + 0.5 * reduced.inertia_derivative * w**2 - reduced.static)

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield columns of a table in SI: forces, and quantities that only the analytic method computes."""
        more = {
            "torque": {
                "inertia": self.reduced.inertia,
                "inertia_derivative": self.reduced.inertia_derivative,
            },
            "power_lost": {"power_stored": self.power_stored},
        }
        for name, values in self.forces.columns():
            yield name, values
            yield from more.get(name, {}).items()
        yield from wrench_columns("frame", self.shaking_force, self.shaking_moment)


def prescribed(
    model: DynamicModel,
    angles: ArrayLike | None = None,
    speed: ArrayLike | None = None,
    acceleration: ArrayLike = 0.0,
    *,
    t: ArrayLike | None = None,
    time: ArrayLike | None = None,
    progress: Progress = no_progress,
    as_run: Motion | None = None,
) -> InverseDynamics:
    """Return the drive torque and all joint reactions at prescribed crank motion, or at times.

    Under motion laws `forces.drives` has each driver's torque or force.

    A coupler with an undetermined rotation about its line has neither torque nor momentum about it.

    Args:
        model: the dynamic model, without `Forces.replaced_by` its drivers.
        angles: crank angles, (n,) in [rad] or text such as "0:360:5deg"; under motion laws use `t`.
        speed: crank speed, scalar or (n,) in [rad/s] or text such as "600rpm".
        acceleration: crank acceleration, scalar or (n,) in [rad/s2].
        t: times, (n,) in [s], of motion laws, or of a crank at a constant `speed` that starts from the
            mechanism's `start` at time zero.
        time: times of the crank angles, (n,) in [s]; by default, at constant speed, time is zero at crank
            angle zero.
        as_run: motion under the same motion laws whose driver values and rates are used; angles, speed and
            acceleration are then those of the motion.
        progress: called with a text and the finished fraction, 0 to 1.

    Raises:
        InputError: for rates that are not finite, loads over time with unknown times, crank angles under
            motion laws, or more instants than fit into memory.
        AssemblyError: where the loops do not close.
        FrictionError: where friction by the load jams the mechanism or is undetermined.
    """
    require("what is to be solved", model, DynamicModel)
    model.forces.require_no_controllers(model.mechanism.name)
    motion_laws = model.solver.motion_laws
    if as_run is not None:
        instants = PathInstants(as_run.angle, as_run.speed, as_run.acceleration, as_run.time)
    else:
        instants = path_instants(model.mechanism, motion_laws, angles, speed, acceleration, t)
        if t is None and speed is None:
            raise InputError(f"{model.mechanism.name}: the crank's speed is missing; give speed= in rad/s")
    time = instants.time if time is None else time
    return prescribed_along(
        model, instants.parameter, instants.rate, instants.second, time=time, progress=progress, as_run=as_run
    )


def prescribed_along(
    model: DynamicModel,
    parameter: ArrayLike,
    rate: ArrayLike,
    second: ArrayLike = 0.0,
    *,
    time: ArrayLike | None = None,
    progress: Progress = no_progress,
    as_run: Motion | None = None,
    actuators: Mapping[str, Array] | None = None,
) -> InverseDynamics:
    """Return the result of `prescribed` at values of the path parameter, with its rates.

    The path parameter is the crank angle in [rad], or under motion laws the time multiplied by
    `motion_laws.rate`. Reactions are those under actuators, joint coordinate -> torque or force (n,),
    to which the drivers add what is missing.
    """
    angle, w, e = crank_motion(model.mechanism.name, parameter, rate, second)
    model = model.starting_at(angle, float(w[0]))
    n, joints = len(angle), len(model.mechanism.joints)
    batch = min(BATCH_SIZE, -(-BATCH_LINKS // len(model.mechanism.links)))
    each = COPIES * (NUMBERS_PER_INSTANT + NUMBERS_PER_JOINT * joints)
    require_memory(f"inverse dynamics of {n:,} instants", n, each, FEWER)
    if time is None:
        times = times_along(model, angle, w, e)
    else:
        times = np.broadcast_to(np.asarray(time, dtype=np.float64), angle.shape)
    standing = np.abs(w) <= STILL * np.abs(w).max()
    chunks: list[InverseDynamics] = []
    for start in range(0, n, BATCH_SIZE):
        whole = slice(start, min(start + BATCH_SIZE, n))
        run = None if as_run is None else select_instants(as_run, whole)
        moved = model.unit_motion(angle[whole], run, within=True)
        for first in range(start, whole.stop, batch):
            rows = slice(first, min(first + batch, whole.stop))
            unit = moved.select(slice(first - start, rows.stop - start))
            instants = None if times is None else times[rows]
            acting = {name: effort[rows] for name, effort in (actuators or {}).items()}
            chunks.append(moved_as(model, unit, w[rows], e[rows], instants, standing[rows], acting))
            progress(f"{rows.stop:,} of {n:,} instants", rows.stop / n)
    return chunks[0] if len(chunks) == 1 else _joined(chunks)


def times_along(model: DynamicModel, angle: Array, speed: Array, acceleration: Array) -> Array | None:
    """Return times in [s] of motion laws, or of a crank at constant speed; None if unknown."""
    motion_laws = model.solver.motion_laws
    if not motion_laws.crank:
        return motion_laws.time(angle)
    steady = np.ptp(speed) == 0.0 and speed[0] != 0.0 and not acceleration.any()
    return angle / speed if steady else None


def moved_as(
    model: DynamicModel,
    unit: UnitMotion,
    w: Array,
    e: Array,
    times: Array | None,
    standing: NDArray[np.bool_],
    actuators: Mapping[str, Array] | None = None,
) -> InverseDynamics:
    """Return the inverse dynamics of a model for a given motion, all instants together.

    Args:
        model: the dynamic model.
        unit: its motion per radian of the crank; complex, as all results, for complex dimensions.
        w: crank speed, (n,) in [rad/s].
        e: crank acceleration, (n,) in [rad/s2].
        times: times in [s]; None if unknown.
        standing: whether the crank is at rest, (n,).
        actuators: joint coordinate -> torque or force besides those of the drivers, (n,).
    """
    angle, flywheel = unit.angle, model.forces.flywheel
    acting, outside = applied(model, unit), loads(model, unit, times, w)
    inertial = unit.inertial(w, e)
    shared = np.zeros_like(inertial)
    if not unit.drivers:
        # the flywheel and the crank's own load act in the driven joint
        driver = unit.mechanism.crank
        add_couple(unit, shared, driver, (outside.crank - flywheel * e)[:, None] * unit.axis(driver))
    _add_actuators(unit, shared, actuators or {})
    motors = motor_wrenches(model, unit, times, w)
    shared, work = shared + motors, power(unit, motors)
    acting = with_load_friction(unit, model.forces, acting, inertial - outside.wrenches - shared, w)
    reduced = reduced_coefficients(unit, acting, flywheel)
    forces = balance(unit, inertial - acting.total(w) - outside.wrenches - shared)
    torque = reduced.torque(w, e) - outside.torque - work
    force, moment = _shaking(model, unit, inertial, acting.gravity + outside.wrenches, e)
    record = ForceRecord(
        characteristic_length=unit.mechanism.characteristic_length,
        time=times,
        angle=angle,
        speed=w,
        acceleration=e,
        torque=torque,
        reactions=forces.reactions,
        sums=forces.sums,
        gears=forces.gears,
        meshes=forces.meshes,
        undetermined=forces.undetermined,
        kinetic=kinetic_energy_of_links(unit, w, flywheel),
        potential=reduced.energy,
        power_in=(torque + work) * w,
        power_loads=outside.torque * w,
        power_lost=reduced.damping * w**2 + reduced.coulomb * np.abs(w),
        residual=forces.residual,
        sliding=_sliding(acting.dry, np.where(standing, 0.0, np.sign(w))),
        drive_accelerations={name: value * w**2 for name, value in unit.driver_seconds.items()},
        drives={**forces.drives, **forces.holds} if unit.drivers else {},
        locked={} if unit.drivers else forces.holds,
        straight=unit.mechanism.straight,
        at_branch_point=forces.at_branch_point,
    )
    return InverseDynamics(
        model=model,
        forces=record,
        load=outside.torque + work,
        reduced=reduced,
        second_torque=_parameter_torque(unit, forces.drives),
        indeterminacy=forces.indeterminacy,
        shaking_force=force,
        shaking_moment=moment,
    )


def _add_actuators(unit: UnitMotion, stack: Array, actuators: Mapping[str, Array]) -> None:
    """Add the torques and forces of actuators in joints, (n,) each, to a stack of wrenches."""
    for joint in unit.mechanism.joints:
        if {*joint.coordinates} & {*actuators}:
            own = [actuators.get(name, np.zeros(len(unit))) for name in joint.coordinates]
            add_joint_forces(unit, stack, joint, own)


def _parameter_torque(unit: UnitMotion, drives: Mapping[str, Array]) -> Array:
    """Return the drives' power at unit rate of the path parameter, (n,) in [N m]."""
    if not unit.drivers:
        return next(iter(drives.values()))
    return sum((effort * unit.driver_rates[name] for name, effort in drives.items()), np.zeros(len(unit)))


def _shaking(
    model: DynamicModel, unit: UnitMotion, inertial: Array, outside: Array, acceleration: Array
) -> tuple[Array, Array]:
    """Return force and moment about the ground's origin on the frame: applied minus inertial."""
    unbalanced = outside - inertial
    force = unbalanced[..., :3].sum(1)
    moment = (unbalanced[..., 3:] + cross(unit.position, unbalanced[..., :3])).sum(1)
    if not model.forces.flywheel:
        return force, moment
    inertia_torque = model.forces.flywheel * acceleration[:, None] * unit.axis(unit.mechanism.crank)
    return force, moment - inertia_torque


def _sliding(dry: Sequence[Dry], sign: Array) -> Array:
    """Return the direction of motion of each joint with Coulomb friction, (n, k); 0 with a crank at rest."""
    return np.stack([sign * friction.direction for friction in dry], 1) if dry else np.zeros((len(sign), 0))


def _joined(chunks: Sequence[InverseDynamics]) -> InverseDynamics:
    """Return chunks joined; a component is determined if it is in all chunks.

    Chunks with more self-stresses than others are at branch points.
    """

    def bare(reaction: Reaction) -> Reaction:
        projector = (
            np.broadcast_to(np.eye(3), (len(reaction.force), 2, 3, 3))
            if reaction.projector is None
            else reaction.projector
        )
        return replace(reaction, determined=None, projector=projector if indeterminacy else None)

    indeterminacy = min(chunk.indeterminacy for chunk in chunks)
    sound = [chunk for chunk in chunks if chunk.indeterminacy == indeterminacy]

    def joined(select: Callable[[ForceRecord], Mapping[str, Reaction]]) -> dict[str, Reaction]:
        records = [select(chunk.forces) for chunk in chunks]
        return {
            name: replace(
                join([bare(record[name]) for record in records]),
                determined=np.all([select(chunk.forces)[name].is_determined for chunk in sound], 0),
            )
            for name in records[0]
        }

    reactions, sums = joined(lambda record: record.reactions), joined(lambda record: record.sums)
    whole = join([replace(chunk.forces, reactions={}, sums={}) for chunk in chunks])
    branched = [chunk.forces.unbounded | (chunk.indeterminacy > indeterminacy) for chunk in chunks]
    undetermined = frozenset[str]().union(*(chunk.forces.undetermined for chunk in sound))
    return InverseDynamics(
        model=chunks[0].model,
        forces=replace(
            whole,
            reactions=reactions,
            sums=sums,
            undetermined=undetermined,
            at_branch_point=np.concatenate(branched),
        ),
        load=np.concatenate([chunk.load for chunk in chunks]),
        reduced=join([chunk.reduced for chunk in chunks]),
        second_torque=np.concatenate([chunk.second_torque for chunk in chunks]),
        indeterminacy=indeterminacy,
        shaking_force=np.concatenate([chunk.shaking_force for chunk in chunks]),
        shaking_moment=np.concatenate([chunk.shaking_moment for chunk in chunks]),
    )
