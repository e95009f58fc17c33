"""Joint forces over a run of forward dynamics, by the inverse dynamics of its motion."""

from dataclasses import replace

import numpy as np

from mechsim.analytic.dynamics.dynamic_run import DynamicRun
from mechsim.analytic.dynamics.model import DynamicModel
from mechsim.analytic.dynamics.prescribed_motion import InverseDynamics, prescribed
from mechsim.errors import InputError

# difference of the kinetic energies, relative to the largest, above which drivers do not determine the motion
SAME_MOTION = 1e-6


def joint_forces(model: DynamicModel, run: DynamicRun) -> InverseDynamics:
    """Return the joint forces, and the drive forces of the motors, at the instants of a run.

    Raises:
        InputError: if the drivers do not determine the motion of all links.
        AssemblyError: where the loops do not close at the instants.

    Accuracy: without motor and load torque the drive forces are zero to rounding.
    """
    motion = run.motion
    controlled = {controller.coordinate for controller in model.forces.controllers}
    if controlled <= {*model.mechanism.drivers}:
        # drive forces include those of the controllers
        model = replace(model, forces=replace(model.forces, controllers=()))
    if not model.solver.motion_laws.crank:
        # drivers are prescribed as functions of time, with rate 1
        zero = np.zeros_like(run.time)
        motion = replace(motion, angle=run.time, speed=zero + 1.0, acceleration=zero)
    state = motion.angle, motion.speed, motion.acceleration
    with np.errstate(all="ignore"):
        study = prescribed(model, *state, time=run.time, as_run=motion)
    change = np.abs(study.forces.kinetic - run.kinetic).max(initial=0.0)
    if not change <= SAME_MOTION * max(float(run.kinetic.max(initial=0.0)), np.finfo(float).tiny):
        raise InputError(
            f"{model.mechanism.name}: joint forces over a run need drivers that determine "
            "the motion of all links; name a quantity of positions, velocities or energies"
        )
    return study
