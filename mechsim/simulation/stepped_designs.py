"""Steps many designs through a revolution of the crank in one batch; compares them with solved poses."""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import mujoco
import numpy as np

from mechsim.model.finding import POSITION_TOLERANCE
from mechsim.model.motion import JointMotion, Motion, PointMotion, join
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.simulation import loop_jacobian
from mechsim.simulation.design_models import (
    Bools,
    DesignModels,
    Fields,
    Rows,
    clear_same_frame,
)
from mechsim.simulation.driven_run import MAX_DRIVE_ERROR
from mechsim.simulation.dynamics.applied_forces import rigid_forces, soften
from mechsim.simulation.loop_jacobian import CLOSED_ERROR, NEWTON
from mechsim.simulation.mjcf import quiet
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.recording import CHUNK, States, evaluate
from mechsim.simulation.settings import Settings, drive_inertia
from mechsim.simulation.state import HINGE
from mechsim.simulation.stepping import TIME

# steps per call into C, which limits memory
STEPS_PER_CALL = 1024
# intervals of a revolution between states that are compared with solved poses
CHECKED_POSITIONS = 8
# model fields that determine positions of links
POSITION_FIELDS = ("body_pos", "body_quat", "jnt_pos", "jnt_axis", "site_pos", "qpos0")
# equal steps in which a revolution is traced after a failed run
TRACE_STEPS = 36
# maximum ratio of a second Newton step to the first one
MAX_SECOND_STEP = 0.01


@dataclass(frozen=True)
class SteppedDesigns:
    """Result of stepping designs.

    Attributes:
        models: models of the designs.
        fields: fields of the stepped models, (d, ...) each.
        loops: loops of one of the stepped models.
        time: instants of the records, (p,) in [s].
        qpos: positions at the records, (d, p, nq).
        qvel: velocities at the records, (d, p, nv).
        valid: whether the states of each design are finite and its crank follows its motion, (d,).
    """

    models: DesignModels
    fields: Fields
    loops: ModelLoops
    time: Array
    qpos: Array
    qvel: Array
    valid: Bools

    def loops_at(self, rows: Rows, repeat: int) -> ModelLoops:
        """Return the loops of some designs for `repeat` states each, one design after another."""
        return self.loops.with_fields(_repeated(self.fields, [*self.fields], rows, repeat))

    def position_loops(self, rows: Rows, repeat: int) -> ModelLoops:
        """Return the loops as `loops_at` does, with the fields that determine positions of links only."""
        closed = self.models.shared.closed
        return closed.loops.with_fields(_repeated(self.fields, POSITION_FIELDS, rows, repeat))


def _repeated(fields: Fields, names: Sequence[str], rows: Rows, repeat: int) -> Fields:
    return {name: np.repeat(fields[name][rows], repeat, 0) for name in names}


@quiet()
def stepped_designs(
    models: DesignModels, settings: Settings, speed: float, total: int, interval: int
) -> SteppedDesigns:
    """Step designs through a revolution of their cranks at constant speed.

    Designs are stepped as in `stepping.step`, all on the calling thread.

    Args:
        models: models of the designs.
        settings: settings of the stepping.
        speed: speed of the cranks in [rad/s].
        total: steps per revolution.
        interval: steps from one record to the next; it divides the total.
    """
    timestep = REVOLUTION / abs(speed) / total
    shared = models.shared.closed
    loops = replace(shared.loops, model=copy.copy(shared.loops.model))
    settings.apply(loops, timestep)
    fields = _stiffened_fields(models, loops, settings)
    clear_same_frame(loops.model, fields)
    own = loops.with_fields(fields)
    rates = loop_jacobian.tangent(own, own.linearise(models.qpos)[1]) * speed
    sims = own.posed.simulations(loops.model, len(rates), 1)
    sims.bind("qpos")[:], sims.bind("qvel")[:] = models.qpos, rates
    chunks = [(np.zeros((len(rates), 1, 1)), models.qpos[:, None], rates[:, None])]
    for first in range(0, total, interval * max(1, STEPS_PER_CALL // interval)):
        count = min(interval * max(1, STEPS_PER_CALL // interval), total - first)
        out = sims.rollout(count, record=(TIME, "qpos", "qvel"))
        chunks.append(tuple(out[name][:, interval - 1 :: interval] for name in (TIME, "qpos", "qvel")))
    recorded_time, qpos, qvel = (np.concatenate(values, 1) for values in zip(*chunks, strict=True))
    time = timestep * interval * np.arange(recorded_time.shape[1])
    target = models.qpos[:, [loops.crank_address]] + speed * time
    # MuJoCo resets a bad state to time zero
    valid = (np.abs(recorded_time[..., 0] - time) < 0.5 * timestep).all(1) & ~sims.warning[..., 1].any(-1)
    valid &= np.isfinite(qpos).all((1, 2)) & np.isfinite(qvel).all((1, 2))
    valid &= (np.abs(qpos[..., loops.crank_address] - target) < MAX_DRIVE_ERROR).all(1)
    return SteppedDesigns(models, fields, loops, time, qpos, qvel, valid & models.valid)


def _stiffened_fields(models: DesignModels, loops: ModelLoops, settings: Settings) -> Fields:
    """Return the fields of designs as `Settings.apply` sets them in a single model."""
    fields, model = dict(models.fields), models.shared.closed.model
    count, crank = len(models.qpos), loops.crank
    for name in ("body_invweight0", "dof_invweight0", "dof_M0", "dof_armature"):
        fields[name] = fields.get(name, np.repeat(getattr(model, name)[None], count, 0)).copy()
    fields["body_invweight0"] *= settings.compliance_used
    fields["dof_invweight0"] *= settings.compliance_used
    lengths = models.shared.closed.loops.with_fields(fields).characteristic_lengths
    inertia = settings.drive_inertia or drive_inertia(
        fields["body_mass"], fields["body_inertia"], lengths, settings.compliance_used
    )
    fields["dof_M0"][:, crank] += inertia - fields["dof_armature"][:, crank]
    fields["dof_armature"][:, crank] = inertia
    return fields


@dataclass(frozen=True)
class ComparedDesigns:
    """Distances of stepped designs from solved poses.

    Attributes:
        estimate: largest distance of a tracked point at the compared instants, (d,) in [m].
        tolerance: tolerance on the estimate, (d,) in [m]: 1e-4 of the stroke.
        same_assembly: whether each design certainly stays in its initial assembly, (d,).
    """

    estimate: Array
    tolerance: Array
    same_assembly: Bools


def check_designs(stepped: SteppedDesigns) -> ComparedDesigns:
    """Compare stepped designs with poses solved at their own crank angles, at some instants.

    A design leaves its assembly if the sign of its loop determinant changes. The result is uncertain for a
    state from which one Newton step does not reach the solved pose.
    """
    d, p = stepped.qpos.shape[:2]
    indices = np.unique(np.round(np.linspace(0, p - 1, CHECKED_POSITIONS + 1)).astype(int))
    k = len(indices)
    closed = stepped.models.shared.closed
    loops = stepped.position_loops(np.arange(d), k)
    qpos = stepped.qpos[:, indices].reshape(d * k, -1)
    sites = [closed.model.site(name).id for name in closed.track.points]
    with np.errstate(all="ignore"):
        positions = loops.posed.site_positions(qpos)[:, sites]
        residual, jacobian = loops.linearise(qpos)
        signs = loop_jacobian.determinant_sign(loops, jacobian).reshape(d, k)
        stepped_once = loops.displaced(qpos, loop_jacobian.newton_step(loops, residual, jacobian)[0])
        solved = loops.posed.site_positions(stepped_once)[:, sites]
        remaining = loops.closure_error(loops.residual(stepped_once))
        error = loops.closure_error(residual)
        distance = np.sqrt(((positions - solved) ** 2).sum(-1)).max(1).reshape(d, k)
    certain = (
        ((remaining <= MAX_SECOND_STEP * error) | (remaining <= 100.0 * CLOSED_ERROR)).reshape(d, k).all(1)
    )
    same_assembly = (
        certain & (signs == signs[:, :1]).all(1) & (signs[:, 0] != 0.0) & np.isfinite(distance).all(1)
    )
    spans = np.ptp(solved.reshape(d, k, len(sites), 3), axis=1)
    tolerance = np.maximum(
        POSITION_TOLERANCE * 0.5 * spans.max((1, 2)),
        CLOSED_ERROR * loops.characteristic_lengths.reshape(d, k)[:, 0],
    )
    return ComparedDesigns(distance.max(1), tolerance, same_assembly)


def first_open_angle(stepped: SteppedDesigns, rows: Rows) -> Array:
    """Return the first crank angle at which the loops of designs do not close, (k,) in [rad]; else NaN.

    Each design is traced over a revolution in equal steps: a prediction along the tangent, corrected by
    Newton's method.
    """
    loops = stepped.position_loops(rows, 1)
    address = loops.crank_address
    qpos = stepped.models.qpos[rows]
    first = qpos[:, address].copy()
    angles = np.where(stepped.models.valid[rows], np.nan, 0.0)
    with np.errstate(all="ignore"):
        for angle in REVOLUTION / TRACE_STEPS * np.arange(1.0, TRACE_STEPS + 1.0):
            try:
                tangent = loop_jacobian.tangent(loops, loops.linearise(qpos)[1])
                predicted = loops.displaced(qpos, tangent * (REVOLUTION / TRACE_STEPS))
                predicted[:, address] = first + angle
                predicted, error = loop_jacobian.close_each(loops, predicted)
            except np.linalg.LinAlgError:
                break
            closed = error < NEWTON.rounding
            angles[~closed & np.isnan(angles)] = angle
            qpos = np.where(closed[:, None], predicted, qpos)
    return first + angles


# contents of a motion: joints only, which the states contain; also positions of points; or also all rates and
# accelerations
Content = Literal["joints", "positions", "rates"]


def design_motion(stepped: SteppedDesigns, rows: Rows, records: Rows, content: Content) -> Motion:
    """Return the motions of some designs at some records, one design after another.

    Joints are those of the spanning tree (`SharedModel.joints`); quantities outside `content` are zero.
    """
    step = max(1, CHUNK // len(records))
    chunks = [rows[first : first + step] for first in range(0, len(rows), step)]
    return join([_chunk(stepped, chunk, records, content) for chunk in chunks])


def _chunk(stepped: SteppedDesigns, rows: Rows, records: Rows, content: Content) -> Motion:
    model, track = stepped.loops.model, stepped.models.shared.closed.track
    index = np.ix_(rows, records)
    time = np.tile(stepped.time[records], len(rows))
    states = States(
        time, stepped.qpos[index].reshape(len(time), -1), stepped.qvel[index].reshape(len(time), -1)
    )
    zero_vectors, zeros = np.zeros((len(time), 3)), np.zeros(len(time))
    points: dict[str, PointMotion] = {}
    motion = None
    if content == "rates":
        motion = evaluate(stepped.loops_at(rows, len(records)), track, states, "step")
        points = dict(motion.points)
    elif content == "positions":
        sites = stepped.position_loops(rows, len(records)).posed.site_positions(states.qpos)
        points = {
            name: PointMotion(sites[:, model.site(name).id], zero_vectors, zero_vectors)
            for name in track.points
        }
    joints: dict[str, JointMotion] = {}
    for name, i in stepped.models.shared.joints.items():
        address, dof = model.jnt_qposadr[i], model.jnt_dofadr[i]
        unit = "rad" if model.jnt_type[i] == HINGE else "m"
        acceleration = zeros
        if motion is not None:
            acceleration = motion.joints[track.name(model.joint(i).name)[0]].acceleration
        joints[name] = JointMotion(states.qpos[:, address], states.qvel[:, dof], acceleration, unit)
    loops = stepped.loops
    crank = states.qpos[:, loops.crank_address], states.qvel[:, loops.crank], zeros
    return Motion("step", *crank, points, joints=joints, time=time)


OFF = mujoco.mjtDisableBit.mjDSBL_CONSTRAINT


def design_torque(stepped: SteppedDesigns, rows: Rows, records: Rows, compliance: float) -> Array:
    """Return the drive torque of some designs at some records, (designs, records) in [N m].

    The torque is the inertial force at the crank less gravity, gyroscopic and constraint forces, without
    virtual drive inertia, as for a single model.

    Args:
        stepped: designs with real inertias.
        rows: indices of designs.
        records: indices of recorded instants.
        compliance: factor on the inverse weights of the constraints, as in the stepped runs.
    """
    step = max(1, CHUNK // len(records))
    chunks = [rows[first : first + step] for first in range(0, len(rows), step)]
    return np.concatenate([_torque(stepped, chunk, records, compliance) for chunk in chunks])


def _torque(stepped: SteppedDesigns, rows: Rows, records: Rows, compliance: float) -> Array:
    model = copy.copy(stepped.loops.model)
    factor = soften(model, compliance)
    fields = {name: values[rows] for name, values in stepped.fields.items()}
    for name in ("body_invweight0", "dof_invweight0"):
        fields[name] = factor * fields[name]
    names = "qacc", "qfrc_constraint"
    driven = rigid_forces(
        lambda force: _evaluated(stepped, model, fields, rows, records, names, force),
        len(rows) * len(records),
        model.nv,
    )
    # without constraints and virtual inertia
    unconstrained = copy.copy(stepped.models.shared.closed.model)
    unconstrained.opt.disableflags |= int(OFF)
    unconstrained_fields = {name: values[rows] for name, values in stepped.models.fields.items()}
    clear_same_frame(unconstrained, unconstrained_fields)
    smooth = _evaluated(stepped, unconstrained, unconstrained_fields, rows, records, ("M", "qfrc_smooth"))
    crank = stepped.loops.crank
    inertial = (_row(unconstrained, smooth["M"], crank) * driven["qacc"]).sum(1)
    torque = inertial - smooth["qfrc_smooth"][:, crank] - driven["qfrc_constraint"][:, crank]
    return torque.reshape(len(rows), len(records))


def _evaluated(
    stepped: SteppedDesigns,
    model: mujoco.MjModel,
    fields: Fields,
    rows: Rows,
    records: Rows,
    names: tuple[str, ...],
    force: Array | None = None,
) -> Fields:
    """Return MuJoCo's fields at states of designs, one row per state, under generalised forces (n, nv)."""
    repeated = {name: np.repeat(values, len(records), 0) for name, values in fields.items()}
    loops: ModelLoops = stepped.loops.with_fields(repeated)
    index = np.ix_(rows, records)
    n = len(rows) * len(records)
    sims = loops.posed.simulations(model, n, 1)
    sims.bind("qpos")[:], sims.bind("qvel")[:] = (
        stepped.qpos[index].reshape(n, -1),
        stepped.qvel[index].reshape(n, -1),
    )
    if force is not None:
        sims.bind("qfrc_applied")[:] = force
    results = {name: sims.bind(name) for name in names}
    sims.forward()
    return {name: np.array(values) for name, values in results.items()}


def _row(model: mujoco.MjModel, sparse: Array, dof: int) -> Array:
    """Return a row of mass matrices in MuJoCo's sparse lower-triangular format, (n, nv)."""
    row = np.zeros((len(sparse), model.nv))
    for other in range(model.nv):
        first, count = int(model.M_rowadr[other]), int(model.M_rownnz[other])
        columns = model.M_colind[first : first + count]
        if other == dof:
            row[:, columns] = sparse[:, first : first + count]
        elif dof in columns:
            row[:, other] = sparse[:, first + int(np.flatnonzero(columns == dof)[0])]
    return row
