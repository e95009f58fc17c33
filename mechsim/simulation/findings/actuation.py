"""Actuators that act against each other, the loops or the motion laws of the drivers."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mechsim.mechanism.finding import Finding
from mechsim.numerics.arrays import Array
from mechsim.simulation.findings.inspected import Inspected, Swing, driver_swing, loop_rank
from mechsim.simulation.findings.predicted_gap import moment_arms
from mechsim.simulation.mjcf_reader.coordinates import ON_JOINT, actuator_names
from mechsim.simulation.state import SCALAR, SLIDE, is_disabled

# initial deviation of a servo from its control target that is reported above this value, in [rad] or [m]
KICK = 1e-2
# actuator forces below this fraction of the largest one are ignored
SLIGHT = 1e-3
# control range beyond a joint range that is not reported, as a fraction of the joint range: files round both
# to two digits
EXCESS = 0.01


def fighting(scene: Inspected) -> Iterator[Finding]:
    """Yield actuators that act against each other or the motion."""
    if not scene.model.nu or is_disabled(scene.model, mujoco.mjtDisableBit.mjDSBL_ACTUATION):
        return
    yield from _too_many(scene)
    yield from _off_at_start(scene)
    yield from _against_motion_laws(scene)


def _too_many(scene: Inspected) -> Iterator[Finding]:
    """Yield servos that add no rank to the loops and the other servos, in every sample state."""
    jacobians = [jacobian for jacobian, _ in scene.sample_jacobians]
    arms = [_directions(scene, qpos) for qpos in scene.sample_states]
    for a, name in enumerate(actuator_names(scene.model)):
        if _stiffness(scene, a) <= 0.0:
            continue
        wider = [np.vstack([rows, arm[a]]) for rows, arm in zip(jacobians, arms, strict=True)]
        if any(loop_rank(more) > loop_rank(rows) for more, rows in zip(wider, jacobians, strict=True)):
            jacobians = wider
            continue
        message = (
            f"actuator {name} is redundant: the loops and the other servos determine its joint, so that they "
            "act against each other unless their controls agree exactly"
        )
        yield _finding(scene, a, _stiffness(scene, a), message, f"leave {name} out, or make it a motor")


def _directions(scene: Inspected, qpos: Array) -> Array:
    """Return the moment arms of the actuators as unit vectors, (nu, nv)."""
    arms = moment_arms(scene, qpos)
    return arms / np.maximum(np.linalg.norm(arms, axis=1, keepdims=True), 1e-300)


def _off_at_start(scene: Inspected) -> Iterator[Finding]:
    """Yield servos that start away from their target at control 0.

    Only the reference configuration is checked: keyframes have their own controls.
    """
    model = scene.model
    if not np.array_equal(scene.read.qpos, model.qpos0):
        return
    for a, name in enumerate(actuator_names(model)):
        kp, force = _stiffness(scene, a), float(scene.started.actuator_force[a])
        off = force / kp if kp > 0.0 else 0.0
        if int(model.actuator_trntype[a]) in ON_JOINT and abs(off) > KICK:
            target = f"{abs(off):.3g} from the target of its control, 0"
            message = f"actuator {name} starts {target}, with a force of {abs(force):.3g}"
            yield _finding(scene, a, abs(force), message, "give it the control of the start by --ctrl")


def _against_motion_laws(scene: Inspected) -> Iterator[Finding]:
    """Yield servos with control 0 that act against the motion laws of the drivers."""
    motion = None if scene.motion_laws.crank else driver_swing(scene)
    if motion is None:
        return
    forces = _actuator_forces(scene, motion)
    for a, name in enumerate(actuator_names(scene.model)):
        largest = float(np.abs(forces[:, a]).max(initial=0.0))
        if _stiffness(scene, a) > 0.0 and largest > SLIGHT * float(np.abs(forces).max()):
            message = (
                f"actuator {name} fights the drive: at control 0 it works against the motion laws by up to "
                f"{largest:.3g} N or N m"
            )
            remedy = "drive by its own control (--ctrl), or leave it out of the scene"
            yield _finding(scene, a, largest, message, remedy)


def controls_beyond_range(scene: Inspected) -> Iterator[Finding]:
    """Yield servos whose control range goes beyond the range of their joint."""
    model = scene.model
    if is_disabled(model, mujoco.mjtDisableBit.mjDSBL_LIMIT):
        return
    for a in np.flatnonzero(model.actuator_ctrllimited).tolist():
        kp, joint = _stiffness(scene, a), int(model.actuator_trnid[a, 0])
        if kp <= 0.0 or int(model.actuator_trntype[a]) not in ON_JOINT or not model.jnt_limited[joint]:
            continue
        if int(model.jnt_type[joint]) not in SCALAR or not model.actuator_gear[a, 0]:
            continue
        gain, offset = model.actuator_gainprm[a, 0], model.actuator_biasprm[a, 0]
        ends = (gain * model.actuator_ctrlrange[a] + offset) / kp / model.actuator_gear[a, 0]
        (low, high), (least, most) = np.sort(ends).tolist(), model.jnt_range[joint].tolist()
        excess = max(least - low, high - most)
        if not excess > EXCESS * (most - least):
            continue
        name, unit = actuator_names(model)[a], "m" if int(model.jnt_type[joint]) == SLIDE else "rad"
        message = (
            f"actuator {name} has controls for {low:.4g} to {high:.4g} {unit}, {excess:.3g} {unit} "
            f"beyond the range of {model.joint(joint).name}, {least:.4g} to {most:.4g}"
        )
        remedy = f"take ctrlrange for {least:.4g} to {most:.4g} {unit}, or widen the range of the joint"
        yield _finding(scene, a, excess, message, remedy, "control-range")


def _actuator_forces(scene: Inspected, motion: Swing) -> Array:
    """Return the actuator forces over a motion with all controls zero, (n, nu)."""
    data, forces = mujoco.MjData(scene.model), list[Array]()
    for qpos, qvel in zip(motion.qpos, motion.qvel, strict=True):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_fwdPosition(scene.model, data)
        mujoco.mj_fwdVelocity(scene.model, data)
        mujoco.mj_fwdActuation(scene.model, data)
        forces.append(data.actuator_force.copy())
    return np.array(forces)


def _stiffness(scene: Inspected, actuator: int) -> float:
    """Return the stiffness of an actuator, the decrease of force per unit of length; 0 for a motor."""
    if int(scene.model.actuator_biastype[actuator]) != int(mujoco.mjtBias.mjBIAS_AFFINE):
        return 0.0
    return -float(scene.model.actuator_biasprm[actuator, 1])


def _finding(
    scene: Inspected, a: int, by: float, message: str, remedy: str, kind: str = "actuator"
) -> Finding:
    name = actuator_names(scene.model)[a]
    return scene.finding(kind, scene.read.spec.actuators[a], by, message, remedy, name)
