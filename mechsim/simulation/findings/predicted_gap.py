"""Predicts loop-closure errors: the gap at which the stiffness of a constraint balances its force.

MuJoCo requests the acceleration -b v - k d r of a gap r. The actual acceleration differs from it by R f, the
force f times the regularisation R. The gap is at rest at r = -R f / (k d). The factors b and k come from
`solref`, the impedance d and R from `solimp`. The forces are those of a motion with closed loops. Dampers
that the integrator treats implicitly withhold a fraction of the acceleration. The prediction is valid for
motions that are slow compared with the time constant of the loops.
"""

import math
from collections.abc import Mapping
from copy import copy
from dataclasses import replace

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import SPARSE
from mechsim.simulation.findings.inspected import EQUALITY, RANK_TOLERANCE, Inspected, Swing, null_space
from mechsim.simulation.mjcf_reader.coordinates import actuated_joints, actuator_count
from mechsim.simulation.state import data_at, dense_rows, is_disabled, mass_matrix

EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
IMPLICIT = (int(mujoco.mjtIntegrator.mjINT_IMPLICIT), int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST))
OFF = mujoco.mjtDisableBit


def damping(model: mujoco.MjModel, moment_arms: Array) -> Array:
    """Return the damping matrix that the integrator of a model treats implicitly, (nv, nv).

    Args:
        model: the model.
        moment_arms: moment arms of the actuators in the DOFs, (nu, nv).
    """
    integrator, result = int(model.opt.integrator), np.zeros((model.nv, model.nv))
    by_euler = integrator == EULER and not is_disabled(model, OFF.mjDSBL_EULERDAMP)
    if (by_euler or integrator in IMPLICIT) and not is_disabled(model, OFF.mjDSBL_DAMPER):
        # damping may be a polynomial, whose first coefficient dominates at low speed
        result = np.diag(np.reshape(model.dof_damping, (model.nv, -1))[:, 0])
    if integrator in IMPLICIT and not is_disabled(model, OFF.mjDSBL_ACTUATION):
        affine = model.actuator_biastype == int(mujoco.mjtBias.mjBIAS_AFFINE)
        rates = np.where(affine, -model.actuator_biasprm[:, 2], 0.0)
        result = result + moment_arms.T @ (np.maximum(rates, 0.0)[:, None] * moment_arms)
    return result


DRY = (int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF), int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON))
# number of bisections of the interval that contains a gap
BISECTIONS = 30
# MuJoCo's largest impedance
MAX_IMPEDANCE = 0.9999


def gaps_at_rest(scene: Inspected) -> dict[int, float]:
    """Return the static gap of each loop under the forces at the start: loop number -> [m] or [rad].

    Actuators are disabled: the large force of a servo away from its target is transient.
    """
    model = copy(scene.loops_only)
    model.opt.disableflags |= int(OFF.mjDSBL_ACTUATION)
    stiff, start = copy(model), scene.read.qpos if scene.closed is None else scene.closed
    # compliant loops carry the forces of rest only after the gaps have opened
    for solimp in (stiff.eq_solimp, stiff.opt.o_solimp):
        solimp[..., :2] = MAX_IMPEDANCE
    data, at_rest = data_at(model, start), data_at(stiff, start)
    force = at_rest.efc_force[at_rest.efc_type == EQUALITY]
    return _gaps(scene, data, force, np.zeros(len(force)), {})


def gaps_in(scene: Inspected, motion: Swing) -> dict[int, float]:
    """Return the largest gap of each loop over a motion: loop number -> [m] or [rad]."""
    model, data, widest = scene.loops_only, scene.loop_data, dict[int, float]()
    inputs = drive_directions(scene)
    free = null_space(inputs) if len(inputs) else np.eye(model.nv)
    implicit_damping = damping(model, moment_arms(scene, scene.read.qpos)) * float(model.opt.timestep)
    for qpos, qvel, qacc in zip(motion.qpos, motion.qvel, motion.qacc, strict=True):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        # acceleration before implicit damping, which the integrator reduces to qacc
        withheld = implicit_damping @ qacc
        commanded = qacc + (np.linalg.solve(mass_matrix(data), withheld) if withheld.any() else 0.0)
        jacobian = dense_rows(data)[data.efc_type == EQUALITY]
        force = loop_forces(data, commanded, free)
        widest |= _gaps(scene, data, force, jacobian @ (commanded - qacc), widest)
    return widest


def drive_directions(scene: Inspected) -> Array:
    """Return the force directions of the drivers and locked joints, (k, nv).

    The direction is the moment arm of the joint's first actuator, or the joint itself if it has none.
    """
    model, arms = scene.loops_only, moment_arms(scene, scene.read.qpos)
    rows: list[Array] = []
    for name in (*scene.drivers, *scene.read.mechanism.locked):
        own = np.eye(model.nv)[int(model.joint(name).dofadr[0])]
        acting = (arms[a] for a in range(actuator_count(model)) if name in actuated_joints(model, a))
        rows.append(next(acting, own))
    return np.array(rows).reshape(-1, model.nv)


def moment_arms(scene: Inspected, qpos: Array) -> Array:
    """Return the moment arms of the actuators in the DOFs at coordinates (nq,), (actuators, nv)."""
    model, data = scene.loops_only, scene.loop_data
    data.qpos[:] = qpos
    dense = np.zeros((actuator_count(model), model.nv))
    if model.nu:
        mujoco.mj_fwdPosition(model, data)
        arms = data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
        mujoco.mju_sparse2dense(dense, *arms)
    return dense


def loop_forces(data: mujoco.MjData, qacc: Array, free: Array) -> Array:
    """Return the forces in the constraint rows of the loops for a motion, (m,), at the state in `data`.

    The forces balance along directions `free` (k, nv), across which those of the drivers are unrestricted.
    Redundant rows share a force such that the sum of the regularisation times the squared force is smallest.
    """
    needed = mass_matrix(data) @ qacc + data.qfrc_bias - data.qfrc_passive - data.qfrc_applied
    rows, jacobian = data.efc_type == EQUALITY, dense_rows(data)
    needed -= jacobian.T @ _friction(data, jacobian, qacc)
    jacobian = jacobian[rows]
    force, compliance, acting = np.zeros(len(jacobian)), np.sqrt(data.efc_R[rows]), jacobian.any(1)
    shared = free @ jacobian[acting].T / compliance[acting]
    force[acting] = _least_norm(shared, free @ needed) / compliance[acting]
    return force


def _least_norm(matrix: Array, right: Array) -> Array:
    """Return the least-squares solution of least norm, (m,)."""
    if len(matrix) >= SPARSE:
        from mechsim.numerics.banded import entries_of, least_norm_systems

        entries = entries_of(matrix[None])
        scale = np.abs(entries.values).max(initial=np.finfo(np.float64).tiny)
        systems = least_norm_systems(replace(entries, values=entries.values / scale), {})
        if systems is not None and len(systems.rows) == len(matrix):
            (solution,), (valid,) = systems.least_norm(right[None])
            if valid:
                return solution / scale
    return np.asarray(np.linalg.lstsq(matrix, right, rcond=RANK_TOLERANCE)[0], dtype=np.float64)


def _friction(data: mujoco.MjData, jacobian: Array, qacc: Array) -> Array:
    """Return the Coulomb friction in its rows, (m,), 0 in others; regularised at low speed as in MuJoCo."""
    rate = data.efc_KBIP.reshape(-1, 4)[:, 1]
    stopping = -(rate * data.efc_vel + jacobian @ qacc) / data.efc_R
    dry = np.isin(data.efc_type, DRY)
    return np.where(dry, np.clip(stopping, -data.efc_frictionloss, data.efc_frictionloss), 0.0)


def _gaps(
    scene: Inspected, data: mujoco.MjData, force: Array, deficit: Array, least: Mapping[int, float]
) -> dict[int, float]:
    """Return the equilibrium gaps of loops, whose impedance depends on the gap: loop number -> [m] or [rad].

    Args:
        scene: scene with the loops.
        data: a state of the scene.
        force: forces in the constraint rows of the loops, (m,).
        deficit: accelerations in these rows that the integrator withholds, (m,).
        least: loop number -> lower bound of the returned gap.
    """
    model, rows = scene.loops_only, data.efc_type == EQUALITY
    stiffness, _, now, _ = data.efc_KBIP.reshape(-1, 4)[rows].T
    numbers, first, member = np.unique(data.efc_id[rows], return_index=True, return_inverse=True)
    solimps = model.eq_solimp[numbers]
    if overridden(model):
        solimps[:] = model.opt.o_solimp
    # impedance rises with the gap, so that the gap with the impedance at zero is an upper bound
    low, high = np.clip(solimps[:, :2], 1e-4, MAX_IMPEDANCE).T
    d = np.where(solimps[:, 2] <= 1e-15, 0.5 * (low + high), low)[member]
    # the gap at the impedance d is free_gap (1 - d) / d^2 + withheld / d
    with np.errstate(over="ignore", invalid="ignore"):
        free_gap = force * data.efc_R[rows] * now / (1.0 - now) / stiffness
        withheld = deficit / stiffness
        terms = np.abs(free_gap * (1.0 - d) / d**2 + withheld / d)
    # forces beyond the largest number open a gap without limit
    terms[~np.isfinite(terms)] = math.inf
    # the first three rows of a weld are its position
    own = np.arange(len(member)) - first[member] < 3
    upper = np.hypot.reduceat(np.where(own, terms, 0.0), first).tolist()
    gaps: dict[int, float] = {}
    for i, (number, solimp) in enumerate(zip(numbers.tolist(), solimps, strict=True)):
        gap, floor = upper[i], least.get(number, 0.0)
        if floor < gap < math.inf and solimp[0] != solimp[1]:
            each = own & (member == i)
            gap = _equilibrium_gap(free_gap[each], withheld[each], solimp, gap)
        gaps[number] = max(gap, floor)
    return gaps


def overridden(model: mujoco.MjModel) -> bool:
    """Return whether MuJoCo's global override replaces the compliance of all constraints."""
    return bool(model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE))


def _equilibrium_gap(free_gap: Array, withheld: Array, solimp: Array, high: float) -> float:
    """Return the gap below an upper bound that is consistent with its impedance."""
    low = 0.0
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        d = impedance(solimp, middle)
        # forces of absurd files have squares beyond the largest number
        wider = math.hypot(*(free_gap * (1.0 - d) / d**2 + withheld / d)) > middle
        low, high = (middle, high) if wider else (low, middle)
    return high


def impedance(solimp: Array, gap: float) -> float:
    """Return MuJoCo's impedance of a constraint at a gap, from the five numbers of `solimp`."""
    low, high, width, middle, power = (float(value) for value in solimp)
    low, high = min(max(low, 1e-4), MAX_IMPEDANCE), min(max(high, 1e-4), MAX_IMPEDANCE)
    if low == high or width <= 1e-15:
        return 0.5 * (low + high)
    x = min(abs(gap) / width, 1.0)
    power, middle = max(power, 1.0), min(max(middle, 1e-4), 0.9999)
    if x <= middle:
        y = (x / middle) ** power * middle
    else:
        y = 1.0 - ((1.0 - x) / (1.0 - middle)) ** power * (1.0 - middle)
    return low + y * (high - low)
