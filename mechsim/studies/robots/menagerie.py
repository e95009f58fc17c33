"""Models in the style of MuJoCo Menagerie: position actuators, a closed home keyframe."""

import mujoco
import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.limits import NO_RANGES, Ranges
from mechsim.mechanism.mechanism import Mechanism
from mechsim.simulation.closed_configurations import scalar_dof, straight_path
from mechsim.simulation.joint_map import inertia_and_holding
from mechsim.simulation.mjcf.joints import CRANK, limit_joints, rename_crank

HOME = "home"
# time step in [s] of a model with servos
SERVO_TIMESTEP = 1e-3
# natural frequency in [Hz] of a critically damped position actuator with the inertia of the mechanism
SERVO_FREQUENCY = 10.0
# largest deflection of an actuator under gravity at home, in [rad] or characteristic lengths
DEFLECTION = 0.01


def with_servos(
    spec: mujoco.MjSpec, mechanism: Mechanism, forces: Forces, ranges: Ranges = NO_RANGES
) -> mujoco.MjSpec:
    """Return a model with a position actuator on each driver and a closed keyframe at its start.

    Args:
        spec: specification of the mechanism, with masses and forces.
        mechanism: mechanism with drivers.
        forces: forces on the mechanism.
        ranges: joint limits in [rad] or [m]; limits of cut joints are omitted.

    Raises:
        InputError: if the mechanism has no drivers.
    """
    spec = spec.copy()
    names = list(mechanism.drivers)
    if not names:
        raise InputError(f"{mechanism.name} has no driver for an actuator; name one by --drive")
    # a servo takes the place of the file's own actuator of a driver
    for element in [*spec.keys, *(item for item in spec.actuators if item.target in (CRANK, *names))]:
        spec.delete(element)
    if mechanism.has_crank:
        # a servo needs no virtual drive inertia
        spec.joint(CRANK).armature = forces.flywheel
        rename_crank(spec, names[0])
    limit_joints(spec, ranges)
    model = spec.compile()
    path = straight_path(model, [scalar_dof(model, name) for name in names])
    matrices, weights = inertia_and_holding(path, path.reference[None])
    inertias = np.diagonal(matrices[0])
    stiffness = np.maximum(
        inertias * (2.0 * np.pi * SERVO_FREQUENCY) ** 2,
        np.abs(weights[0]) / (DEFLECTION * path.loops.units[path.drivers]),
    )
    damping = 2.0 * np.sqrt(stiffness * inertias)
    for name, dof, kp, kv in zip(names, path.drivers, stiffness.tolist(), damping.tolist(), strict=True):
        servo = spec.add_actuator(name=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, target=name)
        servo.set_to_position(kp=kp, kv=kv)
        joint = int(path.loops.model.dof_jntid[dof])
        if path.loops.model.jnt_limited[joint]:
            servo.ctrllimited, servo.ctrlrange = 1, path.loops.model.jnt_range[joint]
    spec.add_key(name=HOME, qpos=path.reference, ctrl=path.reference[path.addresses])
    return spec
