"""Dampers that an integrator takes at the end of a step: they hold back what loops were promised.

MuJoCo's constraints ask for accelerations at the inertia M, and its integrators then carry them out at
M + h D with the step h and the dampers D that they take implicitly: of joints under Euler, of actuators
besides under implicit and implicitfast. A loop whose links accelerate opens by what is missing.
"""

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array

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
