"""Inverse dynamics: what a machine needs, and what its joints carry, while its crank moves as prescribed."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.analytic.dynamics.applied_forces import STILL, Dry, add_couple, applied, loads
from mechsim.analytic.dynamics.model import DynamicModel
from mechsim.analytic.dynamics.reactions import balance
from mechsim.analytic.dynamics.reduced_equation import Reduced, coefficients, kinetic_energy
from mechsim.analytic.dynamics.unit_motion import UnitMotion
from mechsim.analytic.path_instants import PathInstants, path_instants
from mechsim.analytic.vector_method.rotations import cross
from mechsim.errors import InputError
from mechsim.model.force_record import ForceRecord, Reaction, wrench_columns
from mechsim.model.masses import LinkMass
from mechsim.model.motion import Motion, join, select_instants, short_repr
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import require
from mechsim.numerics.resources import require_memory

# instants solved in one go, and bytes held at each of them by each element of the matrix that balances links
BATCH_SIZE, STORED_NUMBERS = 4096, 80.0
# numbers kept of an instant, and of a joint in it; each is held twice while parts are put together
KEPT, JOINT, TWICE = 40.0, 27.0, 16.0
FEWER = "take {most} instants at the most"


@dataclass(frozen=True, slots=True, kw_only=True)
class InverseDynamics:
    """What formulas say of a machine under a prescribed crank at n instants, in SI; ground frame.

    Attributes:
        model: the mechanism with its masses and forces.
        forces: what both methods compute; the drive torque is by virtual power and replaces the motor.
            Reactions where a dry friction turns round are without it, halfway between two values.
        load: generalised force of the loads on the crank, (n,) in [N m].
        reduced: coefficients of the reduced equation.
        second_torque: the drive torque by Newton's and Euler's laws, a second route, (n,) in [N m].
        indeterminacy: number of independent self-stresses: forces the joints can hold against each
            other without any load.
        shaking_force: on the frame, by the whole machine, (n, 3) in [N].
        shaking_moment: likewise, about the ground's origin, (n, 3) in [N m].
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
        """The masses of the links, and where each comes from."""
        return self.model.masses

    @property
    def torque_parts(self) -> dict[str, Array]:
        """What the drive torque is made of, (n,) each in [N m]."""
        reduced, w = self.reduced, self.forces.speed
        return {
            "inertia": reduced.inertia * self.forces.acceleration + 0.5 * reduced.inertia_derivative * w**2,
            "weight and springs": -reduced.static,
            "friction": reduced.damping * w + reduced.coulomb * np.sign(w),
            "loads": -self.load,
        }

    @property
    def power_stored(self) -> Array:
        """Rate at which kinetic and potential energy grow, (n,) in [W], from J, J' and statics."""
        w, e, reduced = self.forces.speed, self.forces.acceleration, self.reduced
        return w * (reduced.inertia * e + 0.5 * reduced.inertia_derivative * w**2 - reduced.static)

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield columns of a table in SI: forces, and what only the analytic method computes."""
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
    progress: Callable[[str, float], None] = lambda _, __: None,
    as_run: Motion | None = None,
) -> InverseDynamics:
    """Return the drive torque and everything the joints carry at prescribed crank motion, or at times.

    Under motion laws `efforts.drives` has each driver's torque or force.

    A coupler whose spin nothing determines has no torque about its line and no momentum about it.

    Args:
        model: the dynamic model; its motor is left out.
        angles: crank angles, (n,) in [rad] or text, as "0:360:5deg"; where motion laws drive, give `t`.
        speed: of the crank, scalar or (n,) in [rad/s], or text, as "600rpm".
        acceleration: of the crank, scalar or (n,) in [rad/s2].
        t: times, (n,) in [s], of motion laws, or of a crank at a constant `speed` that stands at the
            mechanism's `start` at time zero.
        time: of crank angles, (n,) in [s]; None at constant speed counts it from crank angle zero.
        as_run: motion under the same motion laws, whose drivers' values and rates are taken; angles, speed
            and acceleration are then those of the motion.
        progress: called with a text and the finished fraction, 0 to 1.

    Raises:
        InputError: for rates that are not finite, loads over time where no time is known, crank angles where
            motion laws drive, or more instants than memory holds.
        AssemblyError: where the loops do not close.
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
    progress: Callable[[str, float], None] = lambda _, __: None,
    as_run: Motion | None = None,
) -> InverseDynamics:
    """Return what `prescribed` does, at values of the path parameter and its rates.

    The path parameter is the crank angle in [rad], or under motion laws the time multiplied by
    `motion_laws.rate`.
    """
    angle = np.atleast_1d(np.asarray(parameter, dtype=np.float64))
    if angle.size:
        model = model.starting_at(angle, float(np.ravel(rate)[0]))
    time = model.solver.motion_laws.time(angle) if time is None else time
    n, joints = len(angle), len(model.mechanism.joints)
    equations = 6.0 * len(model.mechanism.links)
    each = TWICE * (KEPT + JOINT * joints) + STORED_NUMBERS * equations**2 * min(1.0, BATCH_SIZE / n)
    require_memory(f"inverse dynamics of {n:,} instants", n, each, FEWER)
    w, e = _rate("speed", rate, angle), _rate("acceleration", second, angle)
    times = None if time is None else np.broadcast_to(np.asarray(time, dtype=np.float64), angle.shape)
    if times is None and np.ptp(w) == 0.0 and w[0] != 0.0 and not e.any():
        times = angle / w
    standing = np.abs(w) <= STILL * np.abs(w).max()
    chunks: list[InverseDynamics] = []
    for first in range(0, n, BATCH_SIZE):
        rows = slice(first, first + BATCH_SIZE)
        instants = None if times is None else times[rows]
        run = None if as_run is None else select_instants(as_run, rows)
        chunks.append(_solved(model, angle[rows], w[rows], e[rows], instants, standing[rows], run))
        finished = min(first + BATCH_SIZE, n)
        progress(f"{finished:,} of {n:,} instants", finished / n)
    return chunks[0] if len(chunks) == 1 else _joined(chunks)


def _solved(
    model: DynamicModel,
    angle: Array,
    w: Array,
    e: Array,
    times: Array | None,
    standing: NDArray[np.bool_],
    as_run: Motion | None,
) -> InverseDynamics:
    """Return the inverse dynamics of some instants, all in one go."""
    return moved_as(model, model.unit_motion(angle, as_run, within=True), w, e, times, standing)


def moved_as(
    model: DynamicModel,
    unit: UnitMotion,
    w: Array,
    e: Array,
    times: Array | None,
    standing: NDArray[np.bool_],
) -> InverseDynamics:
    """Return the inverse dynamics of a model at given motion, all instants in one go.

    Args:
        model: the dynamic model.
        unit: its motion per radian of the crank; complex, and all that follows, where dimensions are.
        w: speed of the crank, (n,) in [rad/s].
        e: its acceleration, (n,) in [rad/s2].
        times: times in [s]; None where they are not known.
        standing: whether the crank stands, (n,).
    """
    angle, flywheel = unit.angle, model.forces.flywheel
    acting, outside = applied(model, unit), loads(model, unit, times)
    reduced = coefficients(unit, acting, flywheel)
    inertial = unit.inertial(w, e)
    shared = np.zeros_like(inertial)
    if not unit.drivers:
        # the flywheel and the crank's own load act in the driven joint
        driver = unit.mechanism.crank
        add_couple(unit, shared, driver, (outside.crank - flywheel * e)[:, None] * unit.axis(driver))
    forces = balance(unit, inertial - acting.total(w) - outside.wrenches - shared)
    torque = reduced.torque(w, e) - outside.torque
    force, moment = _shaking(model, unit, inertial, acting.gravity + outside.wrenches, e)
    record = ForceRecord(
        characteristic_length=unit.mechanism.characteristic_length,
        time=times,
        angle=angle,
        speed=w,
        acceleration=e,
        torque=torque,
        reactions=forces.reactions,
        gears=forces.gears,
        meshes=forces.meshes,
        undetermined=forces.undetermined,
        kinetic=kinetic_energy(unit, w, flywheel),
        potential=reduced.energy,
        power_in=torque * w,
        power_loads=outside.torque * w,
        power_lost=reduced.damping * w**2 + reduced.coulomb * np.abs(w),
        residual=forces.residual,
        sliding=_sliding(acting.dry, np.where(standing, 0.0, np.sign(w))),
        drive_accelerations=_drive_accelerations(unit, w),
        drives={**forces.drives, **forces.holds} if unit.drivers else {},
        locked={} if unit.drivers else forces.holds,
        straight=unit.mechanism.straight,
        at_branch_point=forces.at_branch_point,
    )
    return InverseDynamics(
        model=model,
        forces=record,
        load=outside.torque,
        reduced=reduced,
        second_torque=_parameter_torque(unit, forces.drives),
        indeterminacy=forces.indeterminacy,
        shaking_force=force,
        shaking_moment=moment,
    )


def _drive_accelerations(unit: UnitMotion, rate: Array) -> dict[str, Array]:
    return {name: second * rate**2 for name, second in unit.driver_seconds.items()}


def _parameter_torque(unit: UnitMotion, drives: Mapping[str, Array]) -> Array:
    """Return the drives' power at unit rate of the path parameter, (n,) in [N m]."""
    if not unit.drivers:
        return next(iter(drives.values()))
    return sum((effort * unit.driver_rates[name] for name, effort in drives.items()), np.zeros(len(unit)))


def _shaking(
    model: DynamicModel, unit: UnitMotion, inertial: Array, outside: Array, acceleration: Array
) -> tuple[Array, Array]:
    """Return force and moment about the ground's origin that the frame feels: outside less inertial."""
    unbalanced = outside - inertial
    force = unbalanced[..., :3].sum(1)
    moment = (unbalanced[..., 3:] + cross(unit.position, unbalanced[..., :3])).sum(1)
    if not model.forces.flywheel:
        return force, moment
    inertia_torque = model.forces.flywheel * acceleration[:, None] * unit.axis(unit.mechanism.crank)
    return force, moment - inertia_torque


def _sliding(dry: Sequence[Dry], sign: Array) -> Array:
    """Return the direction in which each dry friction's joint goes, (n, k); 0 where a crank stands too."""
    return np.stack([sign * friction.direction for friction in dry], 1) if dry else np.zeros((len(sign), 0))


def _joined(chunks: Sequence[InverseDynamics]) -> InverseDynamics:
    """Return parts put end to end; what is not determined in one of them is not determined."""

    def bare(reaction: Reaction) -> Reaction:
        projector = (
            np.broadcast_to(np.eye(3), (len(reaction.force), 2, 3, 3))
            if reaction.projector is None
            else reaction.projector
        )
        return replace(reaction, determined=None, projector=projector if indeterminacy else None)

    indeterminacy = max(chunk.indeterminacy for chunk in chunks)
    whole = join(
        [
            replace(
                chunk.forces,
                reactions={name: bare(reaction) for name, reaction in chunk.forces.reactions.items()},
            )
            for chunk in chunks
        ]
    )
    reactions = {
        name: replace(
            reaction, determined=np.all([chunk.forces.reactions[name].is_determined for chunk in chunks], 0)
        )
        for name, reaction in whole.reactions.items()
    }
    undetermined = frozenset[str]().union(*(chunk.forces.undetermined for chunk in chunks))
    return InverseDynamics(
        model=chunks[0].model,
        forces=replace(whole, reactions=reactions, undetermined=undetermined),
        load=np.concatenate([chunk.load for chunk in chunks]),
        reduced=join([chunk.reduced for chunk in chunks]),
        second_torque=np.concatenate([chunk.second_torque for chunk in chunks]),
        indeterminacy=indeterminacy,
        shaking_force=np.concatenate([chunk.shaking_force for chunk in chunks]),
        shaking_moment=np.concatenate([chunk.shaking_moment for chunk in chunks]),
    )


def _rate(what: str, value: ArrayLike, angle: Array) -> Array:
    try:
        rate = np.broadcast_to(np.asarray(value, dtype=np.float64), angle.shape)
    except ValueError:
        rate = np.full(angle.shape, np.nan)
    if not np.isfinite(rate).all():
        raise InputError(f"crank {what} must be one finite number or {len(angle)} of them; give SI units")
    return rate
