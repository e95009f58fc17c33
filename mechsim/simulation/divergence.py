"""Causes of the divergence of a run in MuJoCo: a joint limit, a contact, a singular pose, or stiffness."""

from collections.abc import Iterator

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.state import SCALAR, is_disabled

# number of last states that are examined
LAST_STATES = 20
# distance from a singular pose, as by `ModelLoops.conditioning`, that counts as near
NEAR_SINGULAR = 1e-2
STIFFNESS_MESSAGE = "stiffness: nothing else was met on the way; take smaller steps, or softer loops"


@quiet()
def limit_or_contact(model: mujoco.MjModel, time: Array, qpos: Array, qvel: Array) -> str:
    """Return the limit or the contact that was active in the last states, as text; empty without one.

    Args:
        model: of the run.
        time: of the states in [s], (n,).
        qpos: (n, nq).
        qvel: (n, nv).
    """
    data = mujoco.MjData(model)
    for i in range(max(0, len(time) - LAST_STATES), len(time)):
        data.qpos[:], data.qvel[:] = qpos[i], qvel[i]
        mujoco.mj_forward(model, data)
        if int(mujoco.mjtConstraint.mjCNSTR_LIMIT_JOINT) in data.efc_type[: data.nefc].tolist():
            return f"a limit: at {time[i]:.4g} s {_limited(model, data)} is at the end of its range"
        if data.ncon:
            pair = [model.body(model.geom_bodyid[g]).name or "the world" for g in data.contact[0].geom]
            return f"a contact: at {time[i]:.4g} s {pair[0]} and {pair[1]} touch"
    return ""


def near_singular(time: Array, distance: Array) -> str:
    """Return the nearby singular pose, as text; empty without one.

    Args:
        time: of the states in [s], (n,).
        distance: of each from a singular pose, (n,), 0 to about 1.
    """
    nearest = int(np.argmin(distance)) if len(distance) else 0
    if not len(distance) or not distance[nearest] < NEAR_SINGULAR:
        return ""
    return f"a singular pose: at {time[nearest]:.4g} s the loops are within {distance[nearest]:.1g} of one"


def _limited(model: mujoco.MjModel, data: mujoco.MjData) -> str:
    """Return the name of the joint that is farthest beyond its range."""
    beyond = [
        max(model.jnt_range[j, 0] - data.qpos[p], data.qpos[p] - model.jnt_range[j, 1])
        if model.jnt_limited[j]
        else -np.inf
        for j, p in enumerate(model.jnt_qposadr)
    ]
    return model.joint(int(np.argmax(beyond))).name or "a joint"


RK4, EULER, DISCRETE = (
    int(getattr(mujoco.mjtIntegrator, f"mjINT_{name}")) for name in ("RK4", "EULER", "DISCRETE")
)


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
    damped = is_disabled(model, mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    integrator = int(model.opt.integrator)
    explicit = integrator == RK4 or (integrator == EULER and damped)
    for j in np.flatnonzero(np.isin(model.jnt_type, SCALAR)):
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
