"""Drive torque and joint reactions of states whose accelerations are known, from MuJoCo's own dynamics."""

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from mechsim.mechanism.force_record import ForceRecord
from mechsim.mechanism.motion import join, replace_instants, weighted_sums
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import RANK_TOLERANCE, SPARSE, pseudo_inverse
from mechsim.numerics.resources import Progress, no_progress
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
from mechsim.simulation.dynamics.bushings import bushing_forces
from mechsim.simulation.dynamics.load_friction import friction_of_state, rubbing_coordinates
from mechsim.simulation.dynamics.loaded_model import AppliedForces, LoadedModel
from mechsim.simulation.dynamics.reactions import transmitted
from mechsim.simulation.poses import follow
from mechsim.simulation.poses.follow import ChangePoint, NearRows, moved_away
from mechsim.simulation.recording import CHUNK, States, closure_acceleration, link_motions
from mechsim.simulation.settings import set_armature
from mechsim.simulation.stepping import rescale_coupled_tendons

if TYPE_CHECKING:
    from mechsim.numerics.banded import SparseMatrices

# numbers of the states solved together, for each degree of freedom of one or of whole matrices: 32 MB
CHUNK_NUMBERS, STATE_NUMBERS = 4_000_000, 100
# ratio of the regularisation of a friction to its inverse inertia, and MuJoCo's smallest impedance (mjMINIMP)
REGULARISATION, MIN_IMPEDANCE = 1e-4, 1e-4


@dataclass(frozen=True, slots=True)
class LoadedState:
    """States with applied forces, but without the forces of loops and drive.

    Attributes:
        states: the n states.
        jacobian: of the loop constraints, (m, nv).
        outer: applied forces.
        plain: MuJoCo's fields under these forces, with open loops.
        rubbing: power lost in friction by the load, (n,) in [W].
    """

    states: States
    jacobian: "SparseMatrices"
    outer: AppliedForces
    plain: Fields
    rubbing: Array


def loaded_state(
    loaded: LoadedModel,
    states: States,
    forces_of: Callable[[LoadedState], ForceRecord] | None = None,
) -> LoadedState:
    """Return states under loads, springs, friction and motor, with open loops and without a drive.

    Args:
        loaded: the mechanism and its forces.
        states: the n states.
        forces_of: the forces of a state, on which friction by the load depends; None leaves it out.
    """
    angle = states.qpos[:, loaded.loops.crank_address]
    model = loaded.looking()
    applied = loaded.nothing(len(angle))
    applied.controls[:] = loaded.controls(angle, states.time)
    rates = loaded.look(model, states, applied)
    loaded.react(rates["actuator_length"], rates["actuator_velocity"], applied.controls)
    jacobian = loaded.loops.sparse(states.qpos)[1]
    constant = together(applied, dry_friction(loaded, rates, states.qvel))
    coordinates = rubbing_coordinates(loaded, rates) if forces_of else []

    def under(frictions: Array) -> LoadedState:
        outer, power = replace(constant, wrenches=constant.wrenches.copy()), np.zeros(len(angle))
        for item, friction in zip(coordinates, frictions.T, strict=True):
            item.apply(loaded, rates, outer, friction)
            power += friction * item.speed
        return LoadedState(states, jacobian, outer, loaded.look(model, states, outer), power)

    if forces_of is None or not coordinates:
        return under(np.zeros((len(angle), 0)))
    name = loaded.mechanism.name
    return under(friction_of_state(coordinates, lambda frictions: forces_of(under(frictions)), name))


def crank_tangent(loaded: LoadedModel, qpos: Array, inertia: "SparseMatrices") -> Array:
    """Return the rates per radian of the crank that keep the loops closed with the least energy, (n, nv).

    A link whose spin is undetermined then has no momentum about its own axis.
    """
    _, jacobian = loaded.loops.sparse(qpos)
    right = np.zeros((len(qpos), jacobian.shape[0] + 1))
    right[:, -1] = 1.0
    return _least(loaded, jacobian, inertia, right)[0]


def drive_and_constraint_forces(
    loaded: LoadedModel, state: LoadedState, crank_acceleration: Array
) -> tuple[Array, Array, Array]:
    """Return accelerations (n, nv), loop multipliers (n, m) and drive torque (n,) of a prescribed crank.

    The equations are M q'' + h = Q + J^T multipliers + torque on the crank, and J q'' + (dJ/dt) q' = 0. The
    crank's q'' is prescribed.
    """
    links = link_motions(loaded.model, loaded.track, state.plain)
    opened = closure_acceleration(loaded.loops, state.states, state.plain["qacc"], links)
    lacking = crank_acceleration - state.plain["qacc"][:, loaded.loops.crank]
    right = np.concatenate([-opened, lacking[:, None]], 1)
    change, multipliers = _least(loaded, state.jacobian, loaded.inertia(state.plain), right)
    return state.plain["qacc"] + change, multipliers[:, :-1], multipliers[:, -1]


def constraint_forces(loaded: LoadedModel, state: LoadedState, fields: Fields) -> tuple[Array, Array]:
    """Return the multipliers of MuJoCo's own constraint forces, and the corresponding drive torque.

    Args:
        loaded: the mechanism and its forces.
        state: result of `loaded_state`.
        fields: MuJoCo's fields of the stepped model in this state.
    """
    forces, scale = fields["qfrc_constraint"], row_scale(loaded, state.jacobian.shape[0])
    jacobian, inertia = loaded.loops.whole(state.jacobian.values.T), loaded.inertia(state.plain)
    # MuJoCo has no constraint rows for driven coordinates: forces on these coordinates replace them
    first_driven = loaded.loops.driven_rows.start
    units = loaded.loops.units
    scaled = np.swapaxes(jacobian * scale[:, None] * units, 1, 2)[..., :first_driven]
    multipliers = np.zeros(scale.shape + forces.shape[:1]).T
    if first_driven:
        solution = pseudo_inverse(scaled) @ (forces * units)[..., None]
        multipliers[:, :first_driven] = scale[:first_driven] * solution[..., 0]

    def drive_force(dof: int) -> Array:
        spent = (inertia.dense[dof].T * fields["qacc"]).sum(1)
        return spent - state.plain["qfrc_smooth"][:, dof] - forces[:, dof]

    drives = loaded.loops.drivers
    if drives.crank:
        return multipliers, drive_force(loaded.loops.crank)
    multipliers[:, first_driven:] = np.stack([drive_force(int(dof)) for dof in drives.dofs], 1)
    # the torque on the path parameter with the power of all drives
    rows = loaded.loops.driven_rows
    return multipliers, -(multipliers[:, rows] * jacobian[:, rows, loaded.loops.crank]).sum(1)


def force_record(
    loaded: LoadedModel, state: LoadedState, qacc: Array, multipliers: Array, torque: Array
) -> ForceRecord:
    """Return all transmitted forces; MuJoCo propagates applied wrenches through the tree."""
    n, crank = len(qacc), loaded.loops.crank
    drive_forces = loaded.nothing(n)
    # the rows of couplings, with those of locked coordinates after them, and of drivers
    coupled_rows, driven = multipliers[:, loaded.loops.coupled_rows].T, loaded.loops.drivers
    holds = dict(zip(loaded.mechanism.locked, coupled_rows[len(loaded.mechanism.laws) :], strict=False))
    drives: dict[str, Array] = {}
    if driven.crank:
        drive_forces.generalised[:, crank] = torque
    else:
        drive_forces.generalised[:, driven.dofs] = multipliers[:, loaded.loops.driven_rows]
        drives = dict(zip(driven.names, multipliers[:, loaded.loops.driven_rows].T, strict=True)) | holds
    placed = native(loaded.model, state.plain)
    loops = loop_forces(loaded, state.plain, multipliers)
    coupled = coupling_forces(loaded, state.plain, state.jacobian, multipliers)
    everything = together(state.outer, placed, loops, coupled, drive_forces)
    fields = loaded.look(loaded.looking(native=False), state.states, everything)
    lost, outer, motor = powers(loaded, state)
    # twice the energy of springs that are actuators, which MuJoCo's energy omits
    springs = loaded.actuators.springs
    stiffness = np.maximum(-loaded.model.actuator_biasprm[springs, 1], np.finfo(np.float64).tiny)
    wound = (state.plain["actuator_force"][:, springs] ** 2 / stiffness).sum(1)
    rates = state.states.qvel
    # scale of the residual: accelerations are zero in uniform rotation and tiny in slow motion, so the square
    # of the crank speed and the accelerations with open loops count too
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
        gears=forces_of_couplings(loaded, multipliers),
        meshes=mesh_forces(loaded, state.plain, multipliers),
        drives=drives,
        locked=holds if driven.crank else {},
        drive_accelerations=dict(zip(driven.names, qacc[:, driven.dofs].T, strict=True)),
        straight=loaded.mechanism.straight,
        kinetic=_kinetic(loaded, rates, state.plain),
        potential=state.plain["energy"][:, 0] + 0.5 * wound + stored_and_lost(loaded, state.plain)[0],
        power_in=torque * rates[:, crank] + motor,
        power_loads=outer,
        power_lost=lost,
        residual=np.abs(fields["qacc"] - qacc).max(1) / largest,
        sliding=sliding(loaded, state.plain, rates),
    )


def row_scale(loaded: LoadedModel, rows: int) -> Array:
    """Return factors that make constraint rows in units of length dimensionless."""
    scale = np.ones(rows)
    scale[: len(loaded.loops.scale)] = loaded.loops.scale
    return scale


def _least(
    loaded: LoadedModel, jacobian: "SparseMatrices", inertia: "SparseMatrices", right: Array
) -> tuple[Array, Array]:
    """Solve A x = right, M x = A^T multipliers: x with least x^T M x, (n, nv), and multipliers, (n, m + 1).

    A consists of the loops' Jacobian, (m, nv), and a last row for the crank. For redundant rows the
    multipliers have the least norm, with rows scaled by `row_scale`.
    """
    scale = row_scale(loaded, jacobian.shape[0] + 1)
    rows = jacobian.scaled(scale)
    if loaded.model.nv >= SPARSE and (solved := _sparse_least(loaded, rows, inertia, scale * right)):
        return solved[0], scale * solved[1]
    rows = rows.with_unit(loaded.loops.crank)
    count = max(1, CHUNK_NUMBERS // loaded.model.nv**2)
    chunks = [slice(i, i + count) for i in range(0, len(right), count)]
    solved = [_whole_least(rows.select(i), inertia.select(i), (scale * right)[i]) for i in chunks]
    x, multipliers = (np.concatenate(each) for each in zip(*solved, strict=True))
    return x, scale * multipliers


def _whole_least(rows: "SparseMatrices", inertia: "SparseMatrices", right: Array) -> tuple[Array, Array]:
    """Return the same by whole matrices."""
    matrix, lower = rows.dense.transpose(2, 1, 0), np.linalg.cholesky(inertia.dense.transpose(2, 0, 1))
    weighted = np.swapaxes(np.linalg.solve(lower, matrix), 1, 2)
    u, values, vt = np.linalg.svd(weighted, full_matrices=False)
    kept = values > RANK_TOLERANCE * values[:, :1]
    inverse = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    scaled = inverse * (np.swapaxes(u, 1, 2) @ right[..., None])[..., 0]
    x = np.linalg.solve(np.swapaxes(lower, 1, 2), np.swapaxes(vt, 1, 2) @ scaled[..., None])[..., 0]
    return np.asarray(x, dtype=np.float64), (u @ (inverse * scaled)[..., None])[..., 0]


def _sparse_least(
    loaded: LoadedModel, rows: "SparseMatrices", inertia: "SparseMatrices", right: Array
) -> tuple[Array, Array] | None:
    """Return the same of many degrees of freedom; None if rows are redundant, or the loops are not banded.

    The crank's value is prescribed, so that it is no unknown: as the path parameter it is in all equations
    of drivers.
    """
    from mechsim.numerics.banded import least_norm_systems

    crank, mass = loaded.loops.crank, inertia.values[inertia.rows == inertia.columns].mean(0)
    # in the units of the mean inertia
    metric = replace(inertia, values=inertia.values / mass)
    others = metric.without(crank).transposed.without(crank)
    systems = least_norm_systems(rows.without(crank), loaded.bands, others)
    if systems is None or not systems.null_bases[1].all():
        return None
    value, column = right[:, -1:], rows.column(crank).T
    first = -value * np.delete(metric.column(crank).T, crank, 1)
    second = (right[:, :-1] - value * column)[:, systems.rows]
    (x,), (opposite,) = systems.solved(first[None], second[None])
    x = np.insert(x, crank, value[:, 0], 1)
    multipliers = np.zeros_like(right)
    multipliers[:, systems.rows] = -mass[:, None] * opposite
    multipliers[:, -1] = inertia.times(x.T)[crank] - (column * multipliers[:, :-1]).sum(1)
    return x, multipliers


def _kinetic(loaded: LoadedModel, rates: Array, plain: Fields) -> Array:
    """Return the kinetic energy, without that of the path parameter, (n,) in [J].

    K = sum of (m v·v + w·I w)/2 over the bodies + sum of armature q'^2 / 2. In q'·M q'/2, by the mass matrix,
    large terms cancel where a fast screw moves a heavy link slowly.
    """
    model, rates = loaded.model, rates.copy()
    masses, moments = model.body_mass.copy(), model.body_inertia.copy()
    if not loaded.loops.drivers.crank:
        parameter = model.dof_bodyid[loaded.loops.crank]
        masses[parameter] = moments[parameter] = rates[:, loaded.loops.crank] = 0.0
    w, about = plain["cvel"][..., :3], plain["subtree_com"][:, model.body_rootid]
    v = plain["cvel"][..., 3:] + np.cross(w, plain["xipos"] - about)
    axes = plain["ximat"].reshape(*w.shape, 3)
    w = (np.swapaxes(axes, -1, -2) @ w[..., None])[..., 0]
    bodies = masses * (v**2).sum(-1) + (moments * w**2).sum(-1)
    return 0.5 * (bodies.sum(-1) + (model.dof_armature * rates**2).sum(-1))


def forces_of_couplings(loaded: LoadedModel, multipliers: Array) -> dict[str, Array]:
    """Return the force of each coupling on its driven side, (n,), from multipliers (n, m)."""
    forces = multipliers[:, loaded.loops.coupled_rows].T
    return dict(zip(loaded.mechanism.named_laws, forces, strict=False))


def stored_and_lost(loaded: LoadedModel, fields: Fields) -> tuple[Array, Array]:
    """Return the energy stored in bushings, (n,) in [J], and the power lost in them, (n,) in [W]."""
    length, velocity = fields["actuator_length"], fields["actuator_velocity"]
    energy, lost = np.zeros((2, len(length)))
    for bushing, columns in loaded.bushings:
        _, own_energy, own_lost = bushing_forces(bushing, length[:, columns], velocity[:, columns])
        energy, lost = energy + own_energy, lost + own_lost
    return energy, lost


def powers(loaded: LoadedModel, state: LoadedState) -> tuple[Array, Array, Array]:
    """Return the power lost, the power of the loads and the power of the motor, (n,) each in [W]."""
    model, kinds, rates = loaded.model, loaded.actuators, state.states.qvel
    power = state.plain["actuator_force"] * state.plain["actuator_velocity"]
    lost = -(state.plain["qfrc_damper"] * rates).sum(1) - power[:, kinds.friction].sum(1)
    lost += (model.dof_frictionloss * np.abs(rates)).sum(1)
    lost += (model.tendon_frictionloss * np.abs(state.plain["ten_velocity"])).sum(1) + state.rubbing
    lost += stored_and_lost(loaded, state.plain)[1]
    loads = slice(kinds.crank_torque.start, kinds.nonlinear.stop)
    motors = power[:, kinds.motor].sum(1) + power[:, kinds.actuators].sum(1)
    return lost, power[:, loads].sum(1), motors


def state_at_crank(loaded: LoadedModel, angle: float, speed: float) -> tuple[Array, Array]:
    """Return the closed state at a crank angle and its rates at a crank speed, (nq,) and (nv,)."""
    qpos = follow.follow(loaded.loops, loaded.qpos, [angle])
    return qpos[0], (_rates(loaded, qpos) * speed)[0]


@dataclass(frozen=True, slots=True)
class Posed:
    """Solved poses and their forces.

    Attributes:
        qpos: closed states, (n, nq).
        states: the same states, moved away from change points, with their rates.
        change_points: change points, and the rows close to each.
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
    """Return the closed states of a crank motion, (n,) each in SI, and its forces, by inverse dynamics.

    At change points torque, energies and powers are limits; forces between links have no limit.

    Raises:
        AssemblyError: if the loops do not close.

    Accuracy: rounding.
    """
    qpos, path = follow.follow_path(loaded.loops, loaded.qpos, angle)
    neighbourhoods = list(path.near_change_points(angle))
    away = moved_away(qpos, neighbourhoods)
    chunks, count = [], max(1, min(CHUNK, CHUNK_NUMBERS // (STATE_NUMBERS * loaded.model.nv)))
    for first in range(0, len(time), count):
        chunk = slice(first, first + count)
        states = States(time[chunk], away[chunk], _rates(loaded, away[chunk]) * speed[chunk, None])
        chunks.append((states, _prescribed_forces(loaded, states, acceleration[chunk])))
        finished = min(first + count, len(time))
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


def _prescribed_forces(loaded: LoadedModel, states: States, acceleration: Array) -> ForceRecord:
    """Return the forces of states with given accelerations of the crank, (n,)."""

    def record_of(state: LoadedState) -> ForceRecord:
        return force_record(loaded, state, *drive_and_constraint_forces(loaded, state, acceleration))

    return record_of(loaded_state(loaded, states, record_of))


def _interpolated_forces(
    loaded: LoadedModel,
    change_point: ChangePoint,
    angle_mod_2pi: float,
    time: float,
    angle: float,
    speed: float,
    acceleration: float,
) -> ForceRecord:
    """Return the interpolated forces of an instant close to a change point, where the loops are singular."""
    count, revolutions = len(change_point.states), angle - angle_mod_2pi
    qpos = change_point.states.copy()
    qpos[:, loaded.loops.crank_address] += revolutions
    states = States(np.full(count, time), qpos, _rates(loaded, qpos) * speed)
    around = _prescribed_forces(loaded, states, np.full(count, acceleration))
    record = weighted_sums(around, change_point.weights(np.array([angle_mod_2pi])))
    # the direction of sliding is -1, 0 or 1
    return replace(record, angle=np.array([angle]), sliding=np.round(record.sliding))


def _rates(loaded: LoadedModel, qpos: Array) -> Array:
    """Return the rates per radian of the crank at closed states, (n, nv)."""
    n = len(qpos)
    rest = States(np.zeros(n), qpos, np.zeros((n, loaded.model.nv)))
    return crank_tangent(loaded, qpos, loaded.inertia(loaded.look(loaded.looking(), rest, loaded.nothing(n))))


# factor on the virtual drive inertia and its torque at variable speed: without it the mechanism's own torque
# would be lost in rounding
LIGHTER = 1e-6


def forces_of_states(
    loaded: LoadedModel,
    stepped: mujoco.MjModel,
    compliance: float,
    states: States,
    force: Array | None = None,
) -> ForceRecord:
    """Return the forces at recorded states of a stepped model, from its own constraint forces.

    With nonlinear couplings they are the forces of the states with closed loops (`_straightened`).

    Args:
        loaded: the mechanism and its forces.
        stepped: the model as stepped, with the drive's inertia.
        compliance: factor on its inverse weights.
        states: recorded states.
        force: of the drives at each state, in addition to the forces that keep their speeds, (n,) or
            (n, drivers) in [N m] or [N].
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
        driving = None if force is None else LIGHTER * force[first : first + CHUNK]

        def record_of(
            state: LoadedState, chunk: States = chunk, driving: Array | None = driving
        ) -> ForceRecord:
            acting = replace(state.outer, generalised=state.outer.generalised.copy())
            if driving is not None:
                acting.generalised[:, moved] += driving
            nonlinear = _coupling_accelerations(loaded, state)
            acting.generalised[:] -= loaded.inertia(state.plain).times(nonlinear.T).T

            def look(force: Array) -> Mapping[str, Array]:
                return loaded.look(model, chunk, replace(acting, generalised=acting.generalised + force))

            fields = rigid_forces(look, *chunk.qvel.shape)
            fields["qacc"] = fields["qacc"] + nonlinear
            multipliers, torque = constraint_forces(loaded, state, fields)
            return force_record(loaded, state, fields["qacc"], multipliers, torque)

        state = loaded_state(loaded, chunk, record_of)
        records.append(record_of(state))
    return join(records)


def _couple(loaded: LoadedModel, model: mujoco.MjModel, compliance: float) -> None:
    """Enable the constraints of nonlinear couplings, including those of followers stepped as drivers.

    Their reference acceleration ignores the constraint violation; `_coupling_accelerations` adds the
    velocity-product term.
    """
    loops = loaded.loops
    dofs = recording.actuated_dofs(loops)[len(loops.driven_dofs) :]
    set_armature(model, dofs, loops.model.dof_armature[dofs])
    model.dof_invweight0[dofs] = compliance * loops.model.dof_invweight0[dofs]
    model.eq_active0[[coupling.equality for coupling in recording.followers(loops)]] = 1
    model.eq_solref[[row.equality for row in (*loops.couplings, *loops.rods) if row.nonlinear]] = 0.0
    rescale_coupled_tendons(loops, model)


def _straightened(loaded: LoadedModel, states: States) -> States:
    """Return states and rates that satisfy nonlinear couplings at the same driver positions.

    After stepping, a nonlinearly coupled coordinate lags by the square of the step: its force is constant
    over each step, or its constraint acts on accelerations alone.
    """
    loops = loaded.loops
    if not any(row.nonlinear for row in (*loops.couplings, *loops.rods)):
        return states
    loops = replace(loops, drivers=loops.drivers.locked_at(states.qpos[:, loops.drivers.addresses].T))
    qpos = loop_jacobian.close(loops, states.qpos)
    # rows of locked drivers omit the rate of the path parameter, on which the drivers' rates depend
    rows = loops.linearise(qpos)[1][:, : loops.driven_rows.start]
    opened = (rows @ states.qvel[..., None])[..., 0]
    kept = np.delete(np.arange(loaded.model.nv), [loops.crank, *loops.driven_dofs])
    qvel = states.qvel.copy()
    qvel[:, kept] -= (pseudo_inverse(rows[:, :, kept]) @ opened[..., None])[..., 0]
    return replace(states, qpos=qpos, qvel=qvel)


def _coupling_accelerations(loaded: LoadedModel, state: LoadedState) -> Array:
    """Return accelerations from the curvature of couplings, (n, nv): p'' times the squared right-side rate.

    So, too, of rods. All other constraints stay satisfied, and crank and drivers do not accelerate. MuJoCo's
    rows (1, -p') omit these accelerations. The remaining ones satisfy its rows once the forces of these
    are subtracted.
    """
    couplings, rods = loaded.loops.couplings, loaded.loops.rods
    if not any(row.nonlinear for row in (*couplings, *rods)):
        return np.zeros_like(state.states.qvel)
    qacc = state.plain["qacc"]
    right = np.zeros((len(qacc), state.jacobian.shape[0] + 1))
    links = link_motions(loaded.model, loaded.track, state.plain)
    opened = closure_acceleration(loaded.loops, state.states, qacc, links)
    for rows in (loaded.loops.rod_rows, loaded.loops.coupled_rows):
        moved = state.jacobian.times(qacc.T).T
        right[:, rows] = moved[:, rows] - opened[:, rows]
    return _least(loaded, state.jacobian, loaded.inertia(state.plain), right)[0]


def stiffen_friction(model: mujoco.MjModel, timestep: float, compliance: float = 1.0) -> None:
    """Make dry friction act within two steps: MuJoCo's default of 20 ms is long relative to a revolution.

    Args:
        model: changed in place.
        timestep: in [s].
        compliance: factor on the weights of degrees of freedom. If several frictions are as hard as that,
            MuJoCo's solver stops at wrong forces; a smaller impedance leaves their regularisation without the
            factor.
    """
    impedance = max(1.0 / (1.0 + REGULARISATION / compliance), MIN_IMPEDANCE)
    for kind, value in (("dof_sol{}", impedance), ("tendon_sol{}_fri", 1.0 - REGULARISATION)):
        # damping of a constraint is 2 / (impedance * time constant)
        getattr(model, kind.format("ref"))[:] = 2.0 * timestep / value, 1.0
        getattr(model, kind.format("imp"))[:] = value, value, 0.001, 0.5, 2.0
