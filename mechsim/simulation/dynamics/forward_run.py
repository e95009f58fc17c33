"""Forward dynamics in MuJoCo: a mechanism whose drivers are free steps in time from an initial state."""

import time as timer
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from mechsim.errors import AssemblyError, MobilityError
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.limits import NO_RANGES, Ranges
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import JointMotion, LinkMotion, Motion, leading_joint
from mechsim.mechanism.motion_laws import State
from mechsim.mechanism.nonlinear_springs import OPEN, Phases, SoftStop
from mechsim.mechanism.scene import Scene
from mechsim.numerics.arrays import CLOSED, Array
from mechsim.numerics.rank import RANK_TOLERANCE, null_space, significant
from mechsim.numerics.resources import Progress, no_progress
from mechsim.simulation import loop_jacobian
from mechsim.simulation.custom_model import with_functions
from mechsim.simulation.dynamics.applied_controls import AppliedControls, dofs_of, prepared
from mechsim.simulation.dynamics.friction import dry_frictions
from mechsim.simulation.dynamics.loaded_model import LoadedModel
from mechsim.simulation.dynamics.stepped_friction import with_placeholders
from mechsim.simulation.mjcf.compiling import compiled, quiet
from mechsim.simulation.mjcf.force_elements import actuator_slices
from mechsim.simulation.mjcf.joints import UNLIMITED, model_names
from mechsim.simulation.mjcf.link_inertias import MASSLESS_FREE, with_accepted_inertia
from mechsim.simulation.mjcf.loop_cuts import cut_loops
from mechsim.simulation.model_loops import ModelLoops, loops_with_crank
from mechsim.simulation.recording import States, add_sensors, link_motions, point_motions
from mechsim.simulation.settings import COMPLIANCE, Settings
from mechsim.simulation.source import assembled
from mechsim.simulation.state import HINGE, SLIDE, data_at, dense_rows, mass_matrix

# RK4 with stiff equalities
FREE = Settings(steps_per_turn=4000, compliance=COMPLIANCE)
# for constraints that are redundant only while the loops are closed: stiff ones brake the mechanism by their
# inconsistency. Of compliances 1e-8 to 1e4 and time constants of 3 to 20 steps these conserve the energy best
# (Bennett linkage: angle to 4e-9 rad with steps that leave 9e-3 rad by stiff equalities)
REDUNDANT = Settings(compliance=100.0, constant_steps=5.0, steps_per_turn=4000)
# largest number by which the stiffness of constraints exceeds an inertia that moves: its digits are lost at
# 1e16, and each of the `ITERATIONS` regains those that are left. A light cam under a loaded follower is at
# 4e16 to 1e20 with stiff equalities, and its motion wrong from the first step
CANCELLED = 1e14
# rate of such a motion relative to the largest that is rounding
STILL = 1e-12
# longest step of a coordinate towards its initial value, in [rad] or characteristic lengths
STEP = 0.05
NO_LINKS: Mapping[str, LinkMotion] = {}
# MuJoCo's results that are recorded
FIELDS = "xpos", "xmat", "site_xpos", "sensordata", "qacc", "energy"
# Newton iterations of MuJoCo's constraint solver with equalities alone, whose cost is quadratic: two refine
# the first; the motions of four_bar, rssr and jansen are then those of twenty
ITERATIONS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class SteppedRun:
    """A run stepped in MuJoCo.

    Attributes:
        motion: of points, links and joints of the tree at the recorded instants.
        kinetic: kinetic energy, (n,) in [J].
        driving: prescribed coordinate -> torque or force that moves it, (n,) in [N m] or [N].
        potential: of gravity and springs, (n,) in [J].
        diverged: whether the state of MuJoCo became invalid; the records then end before.
        compliant: whether redundant loops have compliant constraints, which make accelerations vibrate.
        timestep: in [s].
        steps: number of steps taken.
        seconds: time spent stepping.
        executed: what evaluated the forces, "C" if no step needed Python.
    """

    motion: Motion
    kinetic: Array
    potential: Array
    driving: Mapping[str, Array]
    diverged: bool
    compliant: bool
    timestep: float
    steps: int
    seconds: float
    executed: Literal["C", "Python"]


@dataclass(frozen=True, slots=True)
class Start:
    """A model at its initial state, from which runs with different steps begin.

    Attributes:
        model: the model.
        qpos: coordinates with closed loops, (nq,).
        qvel: rates that satisfy the loops, (nv,).
        activation: states of actuators that have one.
        settings: of the integrator and the constraints.
        phases: phases of the nonlinear springs, if one has memory; else empty.
    """

    model: LoadedModel
    qpos: Array
    qvel: Array
    activation: Array
    settings: Settings
    phases: Phases = ()

    def loop_rounding(self) -> float:
        """Return the mean change of coordinates by the rounding of loops, relative to it and in units.

        It is J^+ times the rounding of each row, mostly along the smallest singular value of the loops J.
        """
        values = np.linalg.svd(_scaled_jacobian(self.model, self.qpos), compute_uv=False)
        values = values[significant(values)]
        return 1.0 / float(values[-1] * len(values) ** 0.5) if len(values) else 1.0

    @quiet()
    def stepped(
        self,
        times: Array,
        substeps: int,
        settings: Settings | None = None,
        prescribed: Mapping[str, State] | None = None,
        progress: Progress = no_progress,
        softer: float = 1.0,
    ) -> SteppedRun:
        """Step the model; see `stepped_run`. `softer` is a factor on all compliance."""
        timestep = float(times[1] - times[0]) / substeps
        settings = settings or self.settings
        compliant = settings == REDUNDANT
        settings = replace(settings, compliance=softer * settings.compliance_used)
        controls = AppliedControls(
            self.model, prepared(self.model, settings, timestep, ITERATIONS, softer), prescribed, self.phases
        )
        begin, start = timer.perf_counter(), (self.qpos, self.qvel, self.activation)
        states, activations, diverged = _steps(controls, start, times, substeps, progress)
        seconds = timer.perf_counter() - begin
        motion, kinetic, potential, driving = _recorded(controls, states, activations, substeps)
        return SteppedRun(
            motion=motion,
            kinetic=kinetic,
            potential=potential,
            driving=driving,
            diverged=diverged,
            compliant=compliant,
            timestep=timestep,
            steps=substeps * (len(states.time) - 1),
            seconds=seconds,
            executed=controls.executed,
        )


def stepped_run(
    mechanism: Mechanism,
    forces: Forces,
    coordinates: Mapping[str, float],
    rates: Mapping[str, float],
    times: Array,
    substeps: int,
    settings: Settings | None = None,
    *,
    kept: set[str] | None = None,
) -> SteppedRun:
    """Step a mechanism from an initial state.

    Args:
        mechanism: links without an inertia are rods.
        forces: applied forces, including the motor.
        coordinates: initial values of joint coordinates, as in `start_of`.
        rates: initial rates per second, likewise.
        times: instants to record, evenly spaced, the first of the initial state, (n,) in [s].
        substeps: number of steps between two recorded instants.
        settings: of the integrator and the constraints; None chooses them by `settings_at`.
        kept: as in `start_of`.

    Raises:
        InputError: for a coordinate that the model does not have.
        AssemblyError: if the loops do not close at the initial values.
    """
    return start_of(mechanism, forces, coordinates, rates, kept=kept).stepped(times, substeps, settings)


@quiet()
def start_of(
    mechanism: Mechanism,
    forces: Forces,
    coordinates: Mapping[str, float],
    rates: Mapping[str, float],
    *,
    kept: set[str] | None = None,
    ranges: Ranges = NO_RANGES,
    links: Mapping[str, LinkMotion] = NO_LINKS,
    activation: Array | None = None,
    phases: Phases = (),
) -> Start:
    """Return the model of a mechanism at an initial state.

    Args:
        mechanism: links without an inertia are rods.
        forces: applied forces, including the motor.
        coordinates: initial values in [m] or [rad] of joint coordinates of the tree.
        rates: initial rates per second, likewise.
        kept: coordinates at which no loop is cut. Values of other coordinates are ignored if a loop is cut
            there. None keeps all coordinates that have a value.
        ranges: joint -> lower and upper limit in [m] or [rad], which are soft in MuJoCo.
        links: link -> its motion, whose first instant gives the rotations and rates of spherical joints.
        activation: states of actuators that have one; None for their initial states.
        phases: phases of the nonlinear springs; empty for contacts that are open.

    Raises:
        InputError: for a coordinate that the model does not have.
        AssemblyError: if the loops do not close at the initial values.
    """
    model = free_model(mechanism, forces, {*coordinates, *rates} if kept is None else kept)
    _limit(model, ranges)
    if kept is not None:
        coordinates, rates = (without_cuts(model, values) for values in (coordinates, rates))
    qpos = model.qpos.copy()
    if len(coordinates) < model.model.nq:
        named = dict.fromkeys((*mechanism.drivers, *(coordinates if kept is None else sorted(kept))))
        independent = _independent(model, [name for name in named if name in coordinates])
        qpos = _moved(model, {name: coordinates[name] for name in independent})
    spins = set_rotations(model.model, qpos, links)
    qpos = closed_near(
        model, model.loops, qpos, *dofs_of(model, coordinates), np.array([*coordinates.values()])
    )
    qvel = _rates(model, qpos, rates, spins)
    if activation is None:
        activation = np.array([a.start for a in forces.actuators if a.inflow is not None])
    springs = forces.nonlinear_springs
    remembered = any(isinstance(spring.law, SoftStop) and spring.law.hysteresis for spring in springs)
    phases = (phases or (OPEN,) * len(springs)) if remembered else ()
    return Start(model, qpos, qvel, activation, settings_at(model, qpos, qvel), phases)


def free_model(mechanism: Mechanism, forces: Forces, kept: set[str]) -> LoadedModel:
    """Return the model of a mechanism and its forces; no loop is cut at the coordinates to keep."""
    described = with_accepted_inertia(mechanism, MASSLESS_FREE)
    drivable = [
        name for joint in mechanism.joints if KINDS[joint.kind].drivable for name in joint.coordinates
    ]
    drivers, cut = tuple(dict.fromkeys((*mechanism.drivers, *sorted(kept.intersection(drivable))))), None
    if not mechanism.has_crank:
        described = replace(described, driver=drivers)
    elif kept - {*mechanism.drivers}:
        cut = _cuts_elsewhere(mechanism, forces, kept)
    placed = with_placeholders(described, forces)
    scene = Scene(level="dynamics", forces=placed, cut=cut)
    try:
        spec = assembled(described, scene)
    except MobilityError:
        # a closed gap couples coordinates that are to be kept, such as those of a joint and of its motor
        described, drivers = replace(described, driver=mechanism.driver), mechanism.drivers
        cut = _cuts_elsewhere(mechanism, forces, kept)
        spec = assembled(described, replace(scene, cut=cut))
    points = tuple(name for name, (link, _) in mechanism.points.items() if link != GROUND)
    track = add_sensors(spec, points)
    compiled_model = compiled(spec)
    scalar = [
        compiled_model.joint(i).name
        for i in range(compiled_model.njnt)
        if int(compiled_model.jnt_type[i]) in (HINGE, SLIDE)
    ]
    names = model_names(described)
    crank = "crank" if described.has_crank else next((names[n] for n in drivers if names[n] in scalar), None)
    # a model that moves freely has no crank of its own: any coordinate takes its place
    loops = loops_with_crank(
        compiled_model, 0 if crank is None else int(compiled_model.joint(crank).dofadr[0])
    )
    loops = with_functions(loops, described.named_laws)
    return LoadedModel(
        loops=loops,
        track=track,
        qpos=compiled_model.qpos0.copy(),
        mechanism=described,
        forces=forces,
        actuators=actuator_slices(forces, compiled_model),
        dry=dry_frictions(compiled_model, placed.friction),
    )


def _limit(model: LoadedModel, ranges: Ranges) -> None:
    """Give the joints of a model their ranges, except those at which a loop is cut."""
    names = without_cuts(model, {name: low for name, (low, _) in ranges.items()})
    joints = model.model.dof_jntid[dofs_of(model, names)[1]]
    model.model.jnt_limited[joints] = True
    limits = np.reshape([ranges[name] for name in names], (-1, 2))
    model.model.jnt_range[joints] = np.clip(limits, -UNLIMITED, UNLIMITED)


def _cuts_elsewhere(mechanism: Mechanism, forces: Forces, kept: set[str]) -> tuple[str, ...] | None:
    """Return joints to cut other than those of coordinates to keep and of friction; None if none suffice."""
    joints = {joint.name for joint in mechanism.joints if kept.intersection(joint.coordinates)}
    joints |= {friction.joint for friction in forces.friction if friction.dry}
    cuts = tuple(joint.name for joint in cut_loops(mechanism, keep=joints, acting=forces.uncut).cuts)
    return cuts if {*cuts} <= {joint.name for joint in mechanism.joints} else None


def without_cuts(model: LoadedModel, values: Mapping[str, float]) -> dict[str, float]:
    """Return the values of those coordinates at which no loop is cut."""
    return {name: value for name, value in values.items() if name in model.joints}


def _independent(model: LoadedModel, names: Sequence[str]) -> list[str]:
    """Return those of the coordinates that are independent in the reference state, with priority in order."""
    jacobian = _scaled_jacobian(model, model.qpos)
    free = null_space(jacobian).T if len(jacobian) else np.eye(model.model.nv)
    chosen = list[str]()
    for name in names:
        rows = free[dofs_of(model, [*chosen, name])[1]]
        if np.linalg.matrix_rank(rows, RANK_TOLERANCE) > len(chosen):
            chosen.append(name)
    return chosen


def _scaled_jacobian(model: LoadedModel, qpos: Array) -> Array:
    """Return the Jacobian of the loops in a state, (rows, nv), in characteristic lengths and radians."""
    loops = model.loops
    return loops.linearise(qpos[None])[1][0] * loops.scale[:, None] * loops.units


def _moved(model: LoadedModel, coordinates: Mapping[str, float]) -> Array:
    """Return the closed state at independent coordinates, (nq,), by short steps from the reference state."""
    addresses, dofs = dofs_of(model, coordinates)
    loops, qpos = model.loops, model.qpos.copy()
    target, begin = np.array([*coordinates.values()]), qpos[addresses].copy()
    lengths = loops.units[dofs]
    steps = max(1, int(np.ceil(np.abs((target - begin) / lengths).max(initial=0.0) / STEP)))
    for k in range(1, steps + 1):
        qpos = closed_near(model, loops, qpos, addresses, dofs, begin + (target - begin) * (k / steps))
    return qpos


def closed_near(
    model: LoadedModel, loops: ModelLoops, qpos: Array, addresses: list[int], dofs: list[int], values: Array
) -> Array:
    """Return the nearest state with closed loops and some coordinates at given values."""
    moved = qpos.copy()
    moved[addresses] = values
    others = np.delete(np.arange(loops.model.nv), dofs)
    step = loop_jacobian.nearest_steps(loops, others)
    (closed,), (gap,) = loop_jacobian.close_each(loops, moved[None], step)
    if not gap <= CLOSED:
        raise AssemblyError(
            f"{model.mechanism.name}: MuJoCo's loops do not close at the initial values; "
            f"a gap of {gap:.3g} is left"
        )
    return closed


def set_rotations(model: mujoco.MjModel, qpos: Array, links: Mapping[str, LinkMotion]) -> dict[int, float]:
    """Set the quaternions of balls in a state from the rotations of links; return the rates of their dofs.

    Links that `links` does not contain, such as virtual bodies, keep their quaternions.
    """
    spins: dict[int, float] = {}
    for joint in np.flatnonzero(model.jnt_type == int(mujoco.mjtJoint.mjJNT_BALL)):
        body = int(model.jnt_bodyid[joint])
        parent, child = model.body(model.body_parentid[body]).name, model.body(body).name
        if child not in links or not (parent in links or parent == "world"):
            continue
        rotation, spin = links[child].rotation[0], links[child].angular_velocity[0]
        carrier = links[parent].rotation[0] if parent in links else np.eye(3)
        spin = spin - (links[parent].angular_velocity[0] if parent in links else 0.0)
        fixed, local = np.empty((2, 4))
        mujoco.mju_negQuat(fixed, model.body_quat[body])
        address, dof = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        mujoco.mju_mat2Quat(local, (carrier.T @ rotation).ravel())
        mujoco.mju_mulQuat(qpos[address : address + 4], fixed, local)
        spins |= dict(zip(range(dof, dof + 3), (rotation.T @ spin).tolist(), strict=True))
    return spins


def _rates(model: LoadedModel, qpos: Array, rates: Mapping[str, float], spins: Mapping[int, float]) -> Array:
    """Return the rates of least norm, (nv,), that satisfy the loops, initial rates and those of some dofs."""
    dofs = [*dofs_of(model, rates)[1], *spins]
    loops = model.loops
    _, jacobian = loops.linearise(qpos[None])
    rows = np.concatenate([jacobian[0], np.eye(model.model.nv)[dofs]]) * loops.units
    right = np.concatenate([np.zeros(jacobian.shape[1]), [*rates.values(), *spins.values()]])
    scale = np.concatenate([loops.scale, 1.0 / loops.units[dofs]])
    solution = np.linalg.pinv(rows * scale[:, None], rcond=RANK_TOLERANCE) @ (right * scale)
    return solution * loops.units


def is_redundant(loops: ModelLoops, qpos: Array) -> bool:
    """Return whether loop constraints depend on one another in a state (nq,); rows of zeros are ignored."""
    _, jacobian = loops.linearise(qpos[None])
    sizes = np.abs(jacobian[0]).max(1, initial=0.0)
    largest = float(sizes.max(initial=0.0))
    rows = jacobian[0][sizes > max(RANK_TOLERANCE * largest, loop_jacobian.rounding(loops))]
    return len(rows) > 0 and int(np.linalg.matrix_rank(rows, RANK_TOLERANCE * largest)) < len(rows)


def settings_at(model: LoadedModel, qpos: Array, qvel: Array) -> Settings:
    """Return the settings of steps: of redundant loops, or stiff ones unless a light motion has a rate.

    MuJoCo factorises M + J^T D J with the mass matrix M, constraints J and their stiffness D. Along a motion
    z, J z = 0, the terms D (J_k z_k)^2 cancel, and what they exceed z^T M z by is lost of that inertia. The
    constraints then yield more. A light cam at rest under its follower keeps stiff ones.
    """
    if is_redundant(model.loops, qpos):
        return REDUNDANT
    stepped = prepared(model, FREE, STEP, ITERATIONS).model
    stepped.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
    data, units = data_at(stepped, qpos), model.loops.units[:, None]
    rows, stiffness = dense_rows(data)[: data.ne], data.efc_D[: data.ne]
    motions = null_space(rows * units.T).T * units
    inertias, directions = np.linalg.eigh(motions.T @ mass_matrix(data) @ motions)
    rates = directions.T @ np.linalg.lstsq(motions, qvel)[0]
    exceeds = (
        float((stiffness[:, None] * (rows * motion) ** 2).max(initial=0.0)) / inertia
        for motion, inertia, rate in zip((motions @ directions).T, inertias, rates, strict=True)
        if abs(rate) > STILL * np.abs(rates).max()
    )
    excess = max(exceeds, default=0.0) / CANCELLED
    return replace(FREE, compliance=COMPLIANCE * max(1.0, excess))


def _steps(
    controls: AppliedControls,
    start: tuple[Array, Array, Array],
    times: Array,
    substeps: int,
    progress: Progress,
) -> tuple[States, Array, bool]:
    """Step the model; return the recorded states, those of actuators, (n, na), and whether it diverged."""
    stepped = controls.loops.model
    data = mujoco.MjData(stepped)
    data.qpos[:], data.qvel[:], data.act[:] = start
    data.time = times[0]
    records = [(data.qpos.copy(), data.qvel.copy(), data.act.copy())]
    with controls.installed(data) as expand:
        functions = any(row.function for row in controls.loops.couplings)
        for time in times[1:].tolist():
            if functions or controls.remembers:
                for _ in range(substeps):
                    expand()
                    controls.begin_step(data)
                    mujoco.mj_step(stepped, data)
            else:
                mujoco.mj_step(stepped, data, nstep=substeps)
            finished = (time - times[0]) / (times[-1] - times[0])
            progress(f"{substeps * (len(times) - 1):,} steps, {time:.4g} s", finished)
            if data.warning.number.any():
                controls.require_covered(time)
                break
            records.append((data.qpos.copy(), data.qvel.copy(), data.act.copy()))
        controls.begin_step(data)
    qpos, qvel, activations = (np.array(values) for values in zip(*records, strict=True))
    return States(times[: len(records)], qpos, qvel), activations, len(records) < len(times)


def _recorded(
    controls: AppliedControls, states: States, activations: Array, substeps: int
) -> tuple[Motion, Array, Array, dict[str, Array]]:
    """Return motion, kinetic and potential energy and driving forces at states recorded after substeps."""
    model, stepped, drives = controls.model, controls.loops.model, controls.drives
    stepped.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
    stepped.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    data, n = mujoco.MjData(stepped), len(states.time)
    fields = {name: np.empty((n, *np.shape(getattr(data, name)))) for name in FIELDS}
    driving = {name: np.empty(n) for name in drives.names}
    with controls.installed(data) as expand:
        for i in range(n):
            data.qpos[:], data.qvel[:], data.time = states.qpos[i], states.qvel[i], states.time[i]
            data.act[:] = activations[i]
            expand()
            controls.return_to(i * substeps)
            mujoco.mj_forward(stepped, data)
            for name, effort in zip(drives.names, drives.forces, strict=True):
                driving[name][i] = effort
            for name, values in fields.items():
                values[i] = getattr(data, name)
    energies = fields["energy"]
    return _motion(model, stepped, states, fields), energies[:, 1], energies[:, 0], driving


def _motion(
    model: LoadedModel, stepped: mujoco.MjModel, states: States, fields: Mapping[str, Array]
) -> Motion:
    """Return the motion from fields of the stepped model at recorded states, (n, ...) each."""
    joints: dict[str, JointMotion] = {}
    numbers, stated = model.joints, model.model
    for joint in model.mechanism.joints:
        kind = KINDS[joint.kind]
        for i, (name, unit) in enumerate(zip(joint.coordinates, kind.units, strict=True)):
            if name not in numbers:
                continue
            index, number = None if kind.single else i, numbers[name]
            address, dof = stated.jnt_qposadr[number], stated.jnt_dofadr[number]
            values = states.qpos[:, address], states.qvel[:, dof], fields["qacc"][:, dof]
            joints[name] = JointMotion(*values, "m" if unit == "m" else "rad", index)
    first = leading_joint(joints, (), len(states.time))
    return Motion(
        source="step",
        angle=first.value,
        speed=first.rate,
        acceleration=first.acceleration,
        points=point_motions(stepped, model.track, fields),
        links=link_motions(stepped, model.track, fields),
        joints=joints,
        time=states.time,
        drivers=tuple(name for name in model.mechanism.drivers if name in joints),
    )
