"""The spring, damper or servo that requires a shorter step than the model's time step."""

from collections.abc import Iterator

import mujoco
import numpy as np

RK4, EULER, DISCRETE = (
    int(getattr(mujoco.mjtIntegrator, f"mjINT_{name}")) for name in ("RK4", "EULER", "DISCRETE")
)
SINGLE = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))


def stiffness_cause(model: mujoco.MjModel) -> str:
    """Return which element requires shorter steps than the model's, as one clause; empty if none does.

    A spring is stable for steps below 2/w, where w is its circular frequency with the inertia that MuJoCo
    assigns to the DOF in the reference configuration; an explicit damper below twice its time constant.
    """
    if int(model.opt.integrator) == DISCRETE:
        return ""
    step, what = min(_longest_steps(model), default=(np.inf, ""))
    own = float(model.opt.timestep)
    if step >= own:
        return ""
    return (
        f"stiffness: {what} asks for steps below {step:.2g} s, and they are {own:g} s; take shorter ones or "
        "the integrator discrete, or make it softer"
    )


def _longest_steps(model: mujoco.MjModel) -> Iterator[tuple[float, str]]:
    """Yield the longest stable step in [s] of each spring, damper and servo, and its name."""
    damped = bool(model.opt.disableflags & int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP))
    integrator = int(model.opt.integrator)
    explicit = integrator == RK4 or (integrator == EULER and damped)
    for j in np.flatnonzero(np.isin(model.jnt_type, SINGLE)):
        dof, name = int(model.jnt_dofadr[j]), model.joint(j).name
        weight = model.dof_invweight0[dof]
        yield _spring(model.jnt_stiffness[j] * weight), f"the spring of joint {name}"
        if explicit:
            yield _damper(model.dof_damping[dof] * weight), f"the damper of joint {name}"
    for t in range(model.ntendon):
        name, weight = model.tendon(t).name, model.tendon_invweight0[t]
        yield _spring(model.tendon_stiffness[t] * weight), f"the spring of tendon {name}"
    for a in np.flatnonzero(model.actuator_trntype == int(mujoco.mjtTrn.mjTRN_JOINT)):
        joint = int(model.actuator_trnid[a, 0])
        weight = model.dof_invweight0[model.jnt_dofadr[joint]] * model.actuator_gear[a, 0] ** 2
        name = f"actuator {model.actuator(a).name}"
        yield _spring(-model.actuator_biasprm[a, 1] * weight), name
        if explicit or integrator == EULER:
            yield _damper(-model.actuator_biasprm[a, 2] * weight), name


def _spring(squared: float) -> float:
    return float(2.0 / np.sqrt(squared)) if squared > 0.0 else np.inf


def _damper(rate: float) -> float:
    return float(2.0 / rate) if rate > 0.0 else np.inf
