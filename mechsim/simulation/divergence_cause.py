"""What made a run in MuJoCo diverge, as far as its last states tell: a limit or a contact."""

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.silence import quiet

# states looked at before the end
LAST_STATES = 20
# part of the way to a singular pose that is near
NEAR_SINGULAR = 1e-2
STIFFNESS_MESSAGE = "stiffness: nothing else was met on the way; take smaller steps, or softer loops"


@quiet()
def limit_or_contact(model: mujoco.MjModel, time: Array, qpos: Array, qvel: Array) -> str:
    """Return the limit or the contact that was met in the last states, in words; empty where none was.

    Args:
        model: as it was run.
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
    """Return that a singular pose was near, in words; empty where none was.

    Args:
        time: of the states in [s], (n,).
        distance: how far each is from a singular pose, (n,), 0 to about 1.
    """
    at = int(np.argmin(distance)) if len(distance) else 0
    if not len(distance) or not distance[at] < NEAR_SINGULAR:
        return ""
    return f"a singular pose: at {time[at]:.4g} s the loops are within {distance[at]:.1g} of one"


def _limited(model: mujoco.MjModel, data: mujoco.MjData) -> str:
    """Return the name of the joint that is farthest beyond its range."""
    beyond = [
        max(model.jnt_range[j, 0] - data.qpos[p], data.qpos[p] - model.jnt_range[j, 1])
        if model.jnt_limited[j]
        else -np.inf
        for j, p in enumerate(model.jnt_qposadr)
    ]
    return model.joint(int(np.argmax(beyond))).name or "a joint"
