"""Drive torque and joint reactions of states whose accelerations are known, from MuJoCo's own dynamics."""

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from mechsim.model.force_record import ForceRecord
from mechsim.model.motion import join, replace_instants, weighted_sums
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import RANK_TOLERANCE, pseudo_inverse
from mechsim.simulation import loop_jacobian, recording
from mechsim.simulation.dynamics.applied_forces import (
    Fields,
    coupling_forces,
    dry_friction,
    loop_forces,
    mesh_forces,
    native,
    rigid_forces,
    sliding,
    soften,
    together,
)
from mechsim.simulation.dynamics.friction import oppose
from mechsim.simulation.dynamics.loaded_model import SITE, AppliedForces, LoadedModel
from mechsim.simulation.dynamics.reactions import transmitted
from mechsim.simulation.poses import follow
from mechsim.simulation.poses.change_points import ChangePoint, NearRows, moved_away
from mechsim.simulation.recording import CHUNK, States, closure_acceleration, link_motions
from mechsim.simulation.settings import set_armature
from mechsim.simulation.stepping import Progress, no_progress, rescale_coupled_tendons


@dataclass(frozen=True, slots=True)
class LoadedState:
    """States and all that acts in them but loops and drive; `plain` is what MuJoCo then makes of them."""

    states: States
    jacobian: Array
    outer: AppliedForces
    plain: Fields


def loaded_state(loaded: LoadedModel, states: States) -> LoadedState:
    """Return states under loads, springs, friction and motor, with their loops open and no drive."""
    angle = states.qpos[:, loaded.loops.crank_address]
    model = loaded.looking()
    applied = loaded.nothing(len(angle))
    applied.controls[:] = loaded.controls(angle, states.time)
    rates = loaded.look(model, states, applied)
    oppose(loaded.dry, rates["actuator_velocity"], applied.controls)
    outer = together(applied, dry_friction(loaded, rates, states.qvel))
    return LoadedState(
        states, loaded.loops.linearise(states.qpos)[1], outer, loaded.look(model, states, outer)
    )


def tangent(loaded: LoadedModel, qpos: Array, inertia: Array) -> Array:
    """Return the rates per radian of the crank that keep the loops closed with the least energy, (n, nv).

    A link whose spin nothing determines then has no momentum about its own line.
    """
    _, jacobian = loaded.loops.linearise(qpos)
    rows = _constraint_rows(loaded, jacobian)
    right = np.zeros(rows.shape[:2])
    right[:, -1] = 1.0
    return _least(rows, row_scale(loaded, rows.shape[1]), inertia, right)[0]


def drive_and_constraint_forces(
    loaded: LoadedModel, state: LoadedState, crank_acceleration: Array
) -> tuple[Array, Array, Array]:
    """Return accelerations (n, nv), loop multipliers (n, m) and drive torque (n,) of a prescribed crank.

    M q'' + h = Q + J' multipliers + torque on the crank, J q'' + J' q' = 0, the crank's q'' given.
    """
    links = link_motions(loaded.model, loaded.track, state.plain)
    opened = closure_acceleration(loaded.loops, state.states, state.plain["qacc"], links)
    lacking = crank_acceleration - state.plain["qacc"][:, loaded.loops.crank]
    right = np.concatenate([-opened, lacking[:, None]], 1)
    rows = _constraint_rows(loaded, state.jacobian)
    change, multipliers = _least(rows, row_scale(loaded, rows.shape[1]), state.plain["inertia"], right)
    return state.plain["qacc"] + change, multipliers[:, :-1], multipliers[:, -1]


def constraint_forces(loaded: LoadedModel, state: LoadedState, fields: Fields) -> tuple[Array, Array]:
    """Return the multipliers of MuJoCo's own constraint forces, and the drive torque that goes with them.

    Args:
        loaded: the mechanism.
        state: the loaded_state.
        fields: what the stepped model makes of it.
    """
    forces, scale = fields["qfrc_constraint"], row_scale(loaded, state.jacobian.shape[1])
    # MuJoCo knows no rows for what motion laws drive: forces on these coordinates stand for them
    first_driven = loaded.loops.driven_rows.start
    units = loaded.loops.units
    scaled = np.swapaxes(state.jacobian * scale[:, None] * units, 1, 2)[..., :first_driven]
    multipliers = np.zeros(scale.shape + forces.shape[:1]).T
    if first_driven:
        solution = pseudo_inverse(scaled) @ (forces * units)[..., None]
        multipliers[:, :first_driven] = scale[:first_driven] * solution[..., 0]

    def drive_force(dof: int) -> Array:
        spent = (state.plain["inertia"][:, dof] * fields["qacc"]).sum(1)
        return spent - state.plain["qfrc_smooth"][:, dof] - forces[:, dof]

    drives = loaded.loops.drivers
    if drives is None:
        return multipliers, drive_force(loaded.loops.crank)
    multipliers[:, first_driven:] = np.stack([drive_force(int(dof)) for dof in drives.dofs], 1)
    return multipliers, _on_parameter(loaded, state.jacobian, multipliers)


def _on_parameter(loaded: LoadedModel, jacobian: Array, multipliers: Array) -> Array:
    """Return the torque on the clock that does the work of all drives, (n,) in [N m]."""
    rows = loaded.loops.driven_rows
    return -(multipliers[:, rows] * jacobian[:, rows, loaded.loops.crank]).sum(1)


def force_record(
    loaded: LoadedModel, state: LoadedState, qacc: Array, multipliers: Array, torque: Array
) -> ForceRecord:
    """Return everything transmitted: all forces act as wrenches, and MuJoCo carries them through the tree."""
    n, crank = len(qacc), loaded.loops.crank
    drive_forces = loaded.nothing(n)
    driven = loaded.loops.drivers
    if driven is None:
        drive_forces.generalised[:, crank] = torque
    else:
        drive_forces.generalised[:, driven.dofs] = multipliers[:, loaded.loops.driven_rows]
    placed = native(loaded.model, state.plain)
    loops = loop_forces(loaded, state.plain, multipliers)
    coupled = coupling_forces(loaded, state.plain, state.jacobian, multipliers)
    everything = together(state.outer, placed, loops, coupled, drive_forces)
    fields = loaded.look(loaded.looking(native=False), state.states, everything)
    lost, outer, motor = powers(loaded, state)
    rates = state.states.qvel
    # rounding is measured by accelerations: links that all turn evenly have none, and those that creep next
    # to none compared with what their weight would give them without the loops
    even = float(np.abs(rates[:, crank]).max()) ** 2
    kept = float(np.abs(state.plain["qacc"]).max())
    largest = max(float(np.abs(qacc).max()), kept, even, np.finfo(np.float64).tiny)
    return ForceRecord(
        characteristic_length=loaded.mechanism.characteristic_length,
        time=state.states.time,
        angle=state.states.qpos[:, loaded.loops.crank_address],
        speed=rates[:, crank],
        acceleration=qacc[:, crank],
        torque=torque,
        reactions={
            joint.name: transmitted(loaded, joint, fields, multipliers) for joint in loaded.mechanism.joints
        },
        gears=_coupled(loaded, multipliers, [*loaded.mechanism.named_laws], 0),
        meshes=mesh_forces(loaded, state.plain, multipliers),
        drives=_drives(loaded, multipliers),
        locked=_holds(loaded, multipliers) if driven is None else {},
        drive_accelerations=_drive_accelerations(loaded, qacc),
        straight=loaded.mechanism.straight,
        kinetic=_kinetic(loaded, rates, state.plain["inertia"]),
        potential=state.plain["energy"][:, 0] + _wound(loaded, state.plain),
        power_in=torque * rates[:, crank] + motor,
        power_loads=outer,
        power_lost=lost,
        residual=np.abs(fields["qacc"] - qacc).max(1) / largest,
        sliding=sliding(loaded, state.plain, rates),
    )


def _constraint_rows(loaded: LoadedModel, jacobian: Array) -> Array:
    """Return the loops' Jacobian with a last row for the crank, (n, m + 1, nv)."""
    row = np.zeros((len(jacobian), 1, loaded.model.nv))
    row[..., loaded.loops.crank] = 1.0
    return np.concatenate([jacobian, row], 1)


def row_scale(loaded: LoadedModel, rows: int) -> Array:
    """Return factors that make rows of lengths free of units."""
    scale = np.ones(rows)
    scale[: len(loaded.loops.scale)] = loaded.loops.scale
    return scale


def _least(rows: Array, scale: Array, inertia: Array, right: Array) -> tuple[Array, Array]:
    """Solve rows x = right, M x = rows' multipliers: x with least x'Mx, (n, nv), and multipliers, (n, m).

    Where rows repeat others, the multipliers are the least that do it, for rows times `scale` (m,).
    """
    lower = np.linalg.cholesky(inertia)
    weighted = np.swapaxes(np.linalg.solve(lower, np.swapaxes(rows, 1, 2)), 1, 2)
    weighted = weighted * scale[:, None]
    u, values, vt = np.linalg.svd(weighted, full_matrices=False)
    kept = values > RANK_TOLERANCE * values[:, :1]
    inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    scaled = inverse * (np.swapaxes(u, 1, 2) @ (scale * right)[..., None])[..., 0]
    x = np.linalg.solve(np.swapaxes(lower, 1, 2), np.swapaxes(vt, 1, 2) @ scaled[..., None])[..., 0]
    return np.asarray(x, dtype=np.float64), scale * (u @ (inverse * scaled)[..., None])[..., 0]


def _drive_accelerations(loaded: LoadedModel, qacc: Array) -> dict[str, Array]:
    drivers = loaded.loops.drivers
    return {} if drivers is None else dict(zip(drivers.names, qacc[:, drivers.dofs].T, strict=True))


def _kinetic(loaded: LoadedModel, rates: Array, inertia: Array) -> Array:
    """Return the energy of motion of all but a clock, (n,) in [J]."""
    if loaded.loops.drivers is not None:
        rates = rates.copy()
        rates[:, loaded.loops.crank] = 0.0
    return 0.5 * (rates * (inertia @ rates[..., None])[..., 0]).sum(1)


def _coupled(loaded: LoadedModel, multipliers: Array, names: Sequence[str], after: int) -> dict[str, Array]:
    """Return the forces of coupled coordinates, of so many names after the first ones."""
    first = loaded.loops.coupled_rows.start + after
    return {name: multipliers[:, first + i] for i, name in enumerate(names)}


def _drives(loaded: LoadedModel, multipliers: Array) -> dict[str, Array]:
    """Return the force of each driver and hold; nothing where a crank is driven."""
    drivers = loaded.loops.drivers
    if drivers is None:
        return {}
    forces = multipliers[:, loaded.loops.driven_rows].T
    return {**dict(zip(drivers.names, forces, strict=True)), **_holds(loaded, multipliers)}


def _holds(loaded: LoadedModel, multipliers: Array) -> dict[str, Array]:
    """Return the force of each hold."""
    return _coupled(loaded, multipliers, [*loaded.mechanism.locked], len(loaded.mechanism.laws))


def _wound(loaded: LoadedModel, fields: Fields) -> Array:
    """Return the energy of springs in revolute joints, which MuJoCo does not count, (n,) in [J]."""
    model = loaded.model
    stiffness = np.where(model.actuator_trntype == SITE, -model.actuator_biasprm[:, 1], 0.0)
    return 0.5 * (stiffness * fields["actuator_length"] ** 2).sum(1)


def powers(loaded: LoadedModel, state: LoadedState) -> tuple[Array, Array, Array]:
    """Return the power lost, of the loads, and of the motor, (n,) each in [W]."""
    model, kinds, rates = loaded.model, loaded.actuators, state.states.qvel
    power = state.plain["actuator_force"] * state.plain["actuator_velocity"]
    lost = -(state.plain["qfrc_damper"] * rates).sum(1) - power[:, kinds.friction].sum(1)
    lost += (model.dof_frictionloss * np.abs(rates)).sum(1)
    lost += (model.tendon_frictionloss * np.abs(state.plain["ten_velocity"])).sum(1)
    loads = slice(kinds.crank_torque.start, kinds.couples.stop)
    return lost, power[:, loads].sum(1), power[:, kinds.motor].sum(1)


def started(loaded: LoadedModel, angle: float, speed: float) -> tuple[Array, Array]:
    """Return the closed state at a crank angle and its rates at a crank speed, (nq,) and (nv,)."""
    qpos = follow.follow(loaded.loops, loaded.qpos, [angle])
    return qpos[0], (_rates(loaded, qpos) * speed)[0]


@dataclass(frozen=True, slots=True)
class Posed:
    """Solved poses and what they need.

    Attributes:
        qpos: closed states, (n, nq).
        states: the same, but moved away from change points, with their rates.
        change_points: which are close to change points.
        forces: of the motion.
    """

    qpos: Array
    states: States
    change_points: NearRows
    forces: ForceRecord


def inverse_dynamics(
    loaded: LoadedModel,
    time: Array,
    angle: Array,
    speed: Array,
    acceleration: Array,
    progress: Progress = no_progress,
) -> Posed:
    """Return the closed states of a crank motion, (n,) each in SI, and what it needs, by inverse dynamics.

    Where two assemblies meet, torque, energies and powers are limits; forces between links have none.

    Raises:
        AssemblyError: where the loops do not close.

    Accuracy: rounding.
    """
    qpos, path = follow.follow_path(loaded.loops, loaded.qpos, angle)
    neighbourhoods = list(path.near_change_points(angle))
    away = moved_away(qpos, neighbourhoods)
    chunks = []
    for first in range(0, len(time), CHUNK):
        chunk = slice(first, first + CHUNK)
        states = States(time[chunk], away[chunk], _rates(loaded, away[chunk]) * speed[chunk, None])
        state = loaded_state(loaded, states)
        chunks.append(
            (
                states,
                force_record(loaded, state, *drive_and_constraint_forces(loaded, state, acceleration[chunk])),
            )
        )
        finished = min(first + CHUNK, len(time))
        progress(f"{finished:,} of {len(time):,} poses", finished / len(time))
    record = join([record for _, record in chunks])
    interpolated = np.zeros(len(time), dtype=np.bool_)
    for change_point, rows, angles_mod_2pi in neighbourhoods:
        for row, crank_angle in zip(rows, angles_mod_2pi, strict=True):
            crank = (float(values[row]) for values in (time, angle, speed, acceleration))
            record = replace_instants(
                record, np.array([row]), _interpolated_forces(loaded, change_point, crank_angle, *crank)
            )
        interpolated[rows] = True
    record = replace(record, at_branch_point=interpolated)
    return Posed(qpos, join([states for states, _ in chunks]), neighbourhoods, record)


def _interpolated_forces(
    loaded: LoadedModel,
    change_point: ChangePoint,
    angle_mod_2pi: float,
    time: float,
    angle: float,
    speed: float,
    acceleration: float,
) -> ForceRecord:
    """Return what an instant needs next to a branch point, where loops are singular: interpolated."""
    count, revolutions = len(change_point.states), angle - angle_mod_2pi
    qpos = change_point.states.copy()
    qpos[:, loaded.loops.crank_address] += revolutions
    states = States(np.full(count, time), qpos, _rates(loaded, qpos) * speed)
    state = loaded_state(loaded, states)
    around = force_record(
        loaded, state, *drive_and_constraint_forces(loaded, state, np.full(count, acceleration))
    )
    record = weighted_sums(around, change_point.weights(np.array([angle_mod_2pi])))
    # the direction of friction is a sign: round it
    return replace(record, angle=np.array([angle]), sliding=np.round(record.sliding))


def _rates(loaded: LoadedModel, qpos: Array) -> Array:
    """Return the rates per radian of the crank at closed states, (n, nv)."""
    n = len(qpos)
    rest = States(np.zeros(n), qpos, np.zeros((n, loaded.model.nv)))
    return tangent(loaded, qpos, loaded.look(loaded.looking(), rest, loaded.nothing(n))["inertia"])


# factor on the virtual drive inertia and its torque where the speed changes: next to so large a torque
# that of the machine would be lost in rounding
LIGHTER = 1e-6


def forces_of_states(
    loaded: LoadedModel,
    stepped: mujoco.MjModel,
    compliance: float,
    states: States,
    force: Array | None = None,
) -> ForceRecord:
    """Return the efforts at recorded states of a stepped model, from its own constraint forces.

    Where a coupling bends they are those of the states with the loops closed (`_straightened`).

    Args:
        loaded: the mechanism.
        stepped: the model as it was stepped, the drive's inertia in it.
        compliance: factor on its inverse weights.
        states: recorded.
        force: of the drives at each state besides what holds their speeds, (n,) or (n, drivers) in [N m]
            or [N].
    """
    model = copy.copy(stepped)
    loaded.prepare(model)
    softened = compliance * soften(model, compliance)
    moved = loaded.loops.driven_dofs
    if force is not None:
        force = force.reshape(len(force), -1)[:, : len(moved)]
        set_armature(model, moved, LIGHTER * model.dof_armature[moved])
    _couple(loaded, model, softened)
    records = []
    for first in range(0, len(states.time), CHUNK):
        chunk = _straightened(loaded, states.chunk(first))
        state = loaded_state(loaded, chunk)
        acting = replace(state.outer, generalised=state.outer.generalised.copy())
        if force is not None:
            acting.generalised[:, moved] += LIGHTER * force[first : first + CHUNK]
        nonlinear = _coupling_accelerations(loaded, state)
        acting.generalised[:] -= (state.plain["inertia"] @ nonlinear[..., None])[..., 0]
        fields = _looked(loaded, model, chunk, acting)
        fields["qacc"] = fields["qacc"] + nonlinear
        multipliers, torque = constraint_forces(loaded, state, fields)
        records.append(force_record(loaded, state, fields["qacc"], multipliers, torque))
    return join(records)


def _looked(
    loaded: LoadedModel, model: mujoco.MjModel, states: States, acting: AppliedForces
) -> dict[str, Array]:
    """Return what MuJoCo makes of states whose constraints are rigid."""

    def look(force: Array) -> Mapping[str, Array]:
        return loaded.look(model, states, replace(acting, generalised=acting.generalised + force))

    return rigid_forces(look, *states.qvel.shape)


def _couple(loaded: LoadedModel, model: mujoco.MjModel, compliance: float) -> None:
    """Let constraints hold all that couplings bend, also what was stepped as the crank is.

    Their reference acceleration ignores the constraint violation; `_coupling_accelerations` adds the
    velocity-product term.
    """
    loops = loaded.loops
    dofs = recording.actuated_dofs(loops)[len(loops.driven_dofs) :]
    set_armature(model, dofs, loops.model.dof_armature[dofs])
    model.dof_invweight0[dofs] = compliance * loops.model.dof_invweight0[dofs]
    model.eq_active0[[coupling.equality for coupling in recording.followers(loops)]] = 1
    model.eq_solref[[coupling.equality for coupling in loops.couplings if coupling.nonlinear]] = 0.0
    rescale_coupled_tendons(loops, model)


def _straightened(loaded: LoadedModel, states: States) -> States:
    """Return states of which those with bending couplings are closed where their drivers stand, as are rates.

    What a coupling bends lags behind by the square of the step: its force is constant over each, or holds it
    by acceleration alone.
    """
    loops = loaded.loops
    if not any(coupling.nonlinear for coupling in loops.couplings):
        return states
    if loops.drivers is not None:
        loops = replace(loops, drivers=loops.drivers.locked_at(states.qpos[:, loops.drivers.addresses].T))
    qpos = loop_jacobian.close(loops, states.qpos)
    # the clock's share in the drivers' rates stands no more
    rows = loops.linearise(qpos)[1][:, : loops.driven_rows.start]
    opened = (rows @ states.qvel[..., None])[..., 0]
    kept = np.delete(np.arange(loaded.model.nv), [loops.crank, *loops.driven_dofs])
    qvel = states.qvel.copy()
    qvel[:, kept] -= (pseudo_inverse(rows[:, :, kept]) @ opened[..., None])[..., 0]
    return replace(states, qpos=qpos, qvel=qvel)


def _coupling_accelerations(loaded: LoadedModel, state: LoadedState) -> Array:
    """Return accelerations, (n, nv), by which couplings bend: p'' times the square of the right side's rate.

    All else stays closed, crank and drivers at rest. MuJoCo's rows (1, -p') leave them out: what is left
    of the accelerations obeys its rows, under the force that these take.
    """
    couplings, rows = loaded.loops.couplings, loaded.loops.coupled_rows
    if not any(coupling.nonlinear for coupling in couplings):
        return np.zeros_like(state.states.qvel)
    constraints = _constraint_rows(loaded, state.jacobian)
    right = np.zeros(constraints.shape[:2])
    right[:, rows] = np.stack(
        [coupling.velocity_product(state.states.qpos, state.states.qvel) for coupling in couplings], 1
    )
    return _least(constraints, row_scale(loaded, constraints.shape[1]), state.plain["inertia"], right)[0]


def stiffen_friction(model: mujoco.MjModel, timestep: float) -> None:
    """Let dry friction hold within two steps: MuJoCo's default of 20 ms is long compared with a turn."""
    for name in ("dof_solref", "tendon_solref_fri"):
        getattr(model, name)[:] = 2.0 * timestep, 1.0
    for name in ("dof_solimp", "tendon_solimp_fri"):
        getattr(model, name)[:] = 0.9999, 0.9999, 0.001, 0.5, 2.0
