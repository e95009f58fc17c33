"""Predicts loop-closure errors: the gap at which a constraint's own stiffness carries its force.

A constraint requests the acceleration -b v - k d r of its gap r and gets it but for R f, its force f times
its regularisation R. It is at rest where r = -R f / (k d): b and k come from `solref`, the impedance d and R
from `solimp`. The forces are those of a motion with closed loops; dampers that the integrator treats
implicitly withhold a fraction of the acceleration. Motions must be slow compared with the time constant of
the loops.
"""

from collections.abc import Mapping
from copy import copy

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.findings.inspected import EQUALITY, Inspected, Swing
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mjcf_reader.coordinates import actuated_joints
from mechsim.simulation.settings import dense_rows

EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
IMPLICIT = (int(mujoco.mjtIntegrator.mjINT_IMPLICIT), int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST))
OFF = mujoco.mjtDisableBit


def damping(model: mujoco.MjModel, moment_arms: Array) -> Array:
    """Return the dampers that a model's integrator takes implicitly, (nv, nv).

    Args:
        model: the model.
        moment_arms: of its actuators by the freedoms, (nu, nv).
    """
    integrator, none = int(model.opt.integrator), np.zeros((model.nv, model.nv))
    if integrator != EULER and integrator not in IMPLICIT:
        return none
    if _off(model, int(OFF.mjDSBL_DAMPER)) or (
        integrator == EULER and _off(model, int(OFF.mjDSBL_EULERDAMP))
    ):
        result = none
    else:
        # a damper may be a polynomial, whose first coefficient counts at low speed
        result = np.diag(np.reshape(model.dof_damping, (model.nv, -1))[:, 0])
    if integrator in IMPLICIT and not _off(model, int(OFF.mjDSBL_ACTUATION)):
        affine = model.actuator_biastype == int(mujoco.mjtBias.mjBIAS_AFFINE)
        rates = np.where(affine, -model.actuator_biasprm[:, 2], 0.0)
        result = result + moment_arms.T @ (np.maximum(rates, 0.0)[:, None] * moment_arms)
    return result


def _off(model: mujoco.MjModel, bit: int) -> bool:
    return bool(int(model.opt.disableflags) & bit)


DRY = (int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF), int(mujoco.mjtConstraint.mjCNSTR_FRICTION_TENDON))
# of the interval in which a gap lies
BISECTIONS = 30
# the hardest impedance that MuJoCo takes
MAX_IMPEDANCE = 0.9999
# singular values below this part of the largest carry no force
RANK_TOLERANCE = 1e-9


def gaps_at_rest(scene: Inspected) -> dict[int, float]:
    """Return by how much each loop will stand open under what acts at the start, in [m] or [rad].

    Actuators are off: a servo away from its target only begins with a large force.
    """
    model = copy(scene.loops_only)
    model.opt.disableflags |= int(OFF.mjDSBL_ACTUATION)
    data = mujoco.MjData(model)
    data.qpos[:] = scene.read.qpos if scene.closed is None else scene.closed
    with quiet():
        mujoco.mj_forward(model, data)
    force = data.efc_force[data.efc_type == EQUALITY]
    return _gaps(scene, data, force, np.zeros(len(force)), {})


def gaps_in(scene: Inspected, motion: Swing) -> dict[int, float]:
    """Return the widest gap of each loop over a motion, loop's number -> [m] or [rad]."""
    model, widest = scene.loops_only, dict[int, float]()
    data, inertia = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    inputs = drive_directions(scene)
    implicit_damping = damping(model, moment_arms(scene, scene.read.qpos)) * float(model.opt.timestep)
    for qpos, qvel, qacc in zip(motion.qpos, motion.qvel, motion.qacc, strict=True):
        data.qpos[:], data.qvel[:] = qpos, qvel
        with quiet():
            mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, inertia)
        # what the constraints must ask for so that the integrator leaves the acceleration meant
        commanded = qacc + np.linalg.solve(inertia, implicit_damping @ qacc)
        rows = data.efc_type == EQUALITY
        jacobian = dense_rows(data)[rows]
        force = loop_forces(scene, data, commanded, inputs)
        widest |= _gaps(scene, data, force, jacobian @ (commanded - qacc), widest)
    return widest


def drive_directions(scene: Inspected) -> Array:
    """Return in which directions efforts move the drivers, (k, nv): by an actuator's tendon or joint."""
    model, arms = scene.loops_only, moment_arms(scene, scene.read.qpos)
    rows: list[Array] = []
    for name in (*scene.drivers, *scene.read.mechanism.locked):
        own = np.zeros(model.nv)
        own[int(model.joint(name).dofadr[0])] = 1.0
        acting = [a for a in range(model.nu) if name in actuated_joints(model, a)]
        rows.append(arms[acting[0]] if acting else own)
    return np.array(rows).reshape(-1, model.nv)


def moment_arms(scene: Inspected, qpos: Array) -> Array:
    """Return the arms of the actuators by the freedoms at coordinates (nq,), (nu, nv)."""
    model = scene.loops_only
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    dense = np.zeros((model.nu, model.nv))
    if model.nu:
        with quiet():
            mujoco.mj_fwdPosition(model, data)
        arms = data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind
        mujoco.mju_sparse2dense(dense, *arms)
    return dense


def loop_forces(scene: Inspected, data: mujoco.MjData, qacc: Array, inputs: Array) -> Array:
    """Return the forces in the rows of the loops that a motion takes, (m,), at a state in `data`.

    Drivers move by what efforts along `inputs` (k, nv) it takes. Redundant rows share a force in proportion
    to their regularisation.
    """
    model = scene.loops_only
    inertia = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, inertia)
    needed = inertia @ qacc + data.qfrc_bias - data.qfrc_passive - data.qfrc_applied
    rows, jacobian = data.efc_type == EQUALITY, dense_rows(data)
    needed -= jacobian.T @ _friction(data, jacobian, qacc)
    jacobian = jacobian[rows]
    compliance = np.sqrt(data.efc_R[rows])
    rest = np.linalg.svd(inputs)[2][len(inputs) :] if len(inputs) else np.eye(model.nv)
    shared = rest @ jacobian.T / compliance
    return (np.linalg.pinv(shared, rcond=RANK_TOLERANCE) @ (rest @ needed)) / compliance


def _friction(data: mujoco.MjData, jacobian: Array, qacc: Array) -> Array:
    """Return the dry friction in its rows, (m,), 0 in others: soft at low speed, as MuJoCo has it."""
    rate = data.efc_KBIP.reshape(-1, 4)[:, 1]
    stopping = -(rate * data.efc_vel + jacobian @ qacc) / data.efc_R
    dry = np.isin(data.efc_type, DRY)
    return np.where(dry, np.clip(stopping, -data.efc_frictionloss, data.efc_frictionloss), 0.0)


def _gaps(
    scene: Inspected, data: mujoco.MjData, force: Array, deficit: Array, least: Mapping[int, float]
) -> dict[int, float]:
    """Return where loops come to rest, their impedance following the gap, loop's number -> [m] or [rad].

    Args:
        scene: of the loops.
        data: a state of it.
        force: in the rows of the loops, (m,).
        deficit: accelerations that the integrator holds back in them, (m,).
        least: loop's number -> gap that is returned if the loop's own is smaller.
    """
    model, rows = scene.loops_only, data.efc_type == EQUALITY
    stiffness, _, now, _ = data.efc_KBIP.reshape(-1, 4)[rows].T
    # a gap is free_gap (1 - d) / d^2 + deficit / d at the impedance d
    free_gap = force * data.efc_R[rows] * now / (1.0 - now) / stiffness
    gaps: dict[int, float] = {}
    for loop in np.unique(data.efc_id[rows]):
        # of a weld the place
        own = np.flatnonzero(data.efc_id[rows] == loop)[:3]
        solimp = model.opt.o_solimp if overridden(model) else model.eq_solimp[loop]
        floor = least.get(int(loop), 0.0)
        gap = _equilibrium_gap(free_gap[own], deficit[own] / stiffness[own], solimp, floor)
        gaps[int(loop)] = max(gap, floor)
    return gaps


def overridden(model: mujoco.MjModel) -> bool:
    """Return whether one compliance replaces those of all constraints."""
    return bool(model.opt.enableflags & int(mujoco.mjtEnableBit.mjENBL_OVERRIDE))


def _equilibrium_gap(free_gap: Array, deficit: Array, solimp: Array, least: float) -> float:
    """Return the gap that is consistent with its own impedance; a bound if that is below `least`."""

    def gap_at(gap: float) -> float:
        d = impedance(solimp, gap)
        return float(np.linalg.norm(free_gap * (1.0 - d) / d**2 + deficit / d))

    # impedance rises with the gap, so that the first value is a bound
    low, high = 0.0, gap_at(0.0)
    if high <= least or solimp[0] == solimp[1]:
        return high
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if gap_at(middle) > middle else (low, middle)
    return high


def impedance(solimp: Array, gap: float) -> float:
    """Return MuJoCo's impedance of a constraint at a gap, by its five numbers of `solimp`."""
    low, high, width, middle, power = (float(value) for value in solimp)
    low, high = min(max(low, 1e-4), MAX_IMPEDANCE), min(max(high, 1e-4), MAX_IMPEDANCE)
    if low == high or width <= 1e-15:
        return 0.5 * (low + high)
    x = min(abs(gap) / width, 1.0)
    if x in (0.0, 1.0):
        return high if x else low
    power, middle = max(power, 1.0), min(max(middle, 1e-4), 0.9999)
    if power == 1.0:
        y = x
    elif x <= middle:
        y = (x / middle) ** power * middle
    else:
        y = 1.0 - ((1.0 - x) / (1.0 - middle)) ** power * (1.0 - middle)
    return low + y * (high - low)
