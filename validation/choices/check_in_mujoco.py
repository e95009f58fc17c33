"""What a tuned file really keeps, reported by plain MuJoCo alone: no loop equations and no run of mechsim's.

The file is stepped by the lines that were written beside it, with `mj_step`. By closure each of its states is
closed by Newton's method on MuJoCo's own rows of equality constraints, the drivers where they were; by
trajectory the reference is the same file with steps and time constants of loops so many times smaller.
"""

import copy
import importlib.util
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Places = Mapping[str, tuple[int, Array]]
# states that are judged, at most; Newton steps; a gap in [m] or [rad] that is closed; rank
STATES, STEPS, CLOSED, RANK = 1500, 12, 1e-9, 1e-9
# how many times smaller the steps of the reference are, and of the one that tells its own error
FINE, COARSE = 16, 8


def script_of(path: Path) -> ModuleType:
    """Return a script that was written next to a file, as a module of its own."""
    spec = importlib.util.spec_from_file_location("tuned_run", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def states_of(script: ModuleType, duration: float) -> tuple[Array, Array]:
    """Return times (n,) and states (n, nq) after every step of a script."""
    result = [(data.time, data.qpos.copy()) for data in script.steps(duration)]
    return np.array([time for time, _ in result]), np.array([state for _, state in result])


def closure_error(script: ModuleType, duration: float, places: Places, drivers: tuple[str, ...]) -> float:
    """Return the worst distance of points from where closed loops have them, drivers as they were, in [m].

    Infinite where a state comes to nothing, or no closed one is near.

    Args:
        script: that steps the file.
        duration: in [s].
        places: of points: body and place in its frame.
        drivers: joints that stay where they are.
    """
    model = _only_equalities(script.model)
    _, states = states_of(script, duration)
    if not np.isfinite(states).all():
        return np.inf
    still = {int(model.joint(name).dofadr[0]) for name in drivers}
    free = np.array([i for i in range(model.nv) if i not in still])
    data, worst = mujoco.MjData(model), 0.0
    for state in states[:: max(1, len(states) // STATES)]:
        data.qpos[:] = state
        mujoco.mj_fwdPosition(model, data)
        observed = _points(data, places)
        if not _close(model, data, free):
            return np.inf
        worst = max(worst, float(np.linalg.norm(_points(data, places) - observed, axis=1).max()))
    return worst


def trajectory_error(script: ModuleType, duration: float, places: Places) -> tuple[float, float]:
    """Return the worst distance of points from a run of small steps at the same times, and its own error."""
    model, step = script.model, float(script.model.opt.timestep)
    constants = model.eq_solref[:, 0].copy()
    _, states = states_of(script, duration)
    model.opt.iterations, model.opt.tolerance = 100, 1e-4 * min(model.opt.tolerance or 1e-20, 1e-8)
    runs: list[Array] = []
    for finer in (COARSE, FINE):
        model.opt.timestep = step / finer
        model.eq_solref[:, 0] = np.where(constants > 0.0, constants / finer, constants)
        runs.append(_tracked(model, states_of(script, duration)[1][finer - 1 :: finer], places))
    own = _tracked(model, states, places)
    count = min(len(own), *(len(run) for run in runs))
    coarse, fine = (run[:count] for run in runs)
    away = np.linalg.norm(own[:count] - fine, axis=2).max()
    return float(away), float(np.linalg.norm(fine - coarse, axis=2).max())


def _only_equalities(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy in which nothing but equalities makes rows."""
    disable = mujoco.mjtDisableBit
    model = copy.copy(model)
    model.opt.disableflags |= int(disable.mjDSBL_CONTACT | disable.mjDSBL_LIMIT | disable.mjDSBL_FRICTIONLOSS)
    model.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
    return model


def _close(model: mujoco.MjModel, data: mujoco.MjData, free: NDArray[np.int_]) -> bool:
    """Bring a state onto the nearest one whose loops are closed; say whether there is one."""
    for _ in range(STEPS):
        gap, gradient = data.efc_pos[: data.nefc], data.efc_J.reshape(-1, model.nv)[: data.nefc]
        step = np.zeros(model.nv)
        step[free] = -np.linalg.pinv(gradient[:, free], rcond=RANK) @ gap
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        mujoco.mj_fwdPosition(model, data)
        if np.abs(step).max(initial=0.0) < CLOSED:
            break
    left = gradient[:, free].T @ data.efc_pos[: data.nefc]
    return bool(np.isfinite(data.qpos).all() and np.abs(left).max(initial=0.0) < CLOSED)


def _points(data: mujoco.MjData, places: Places) -> Array:
    """Return where points are, (k, 3) in [m]."""
    return np.array([data.xpos[body] + data.xmat[body].reshape(3, 3) @ at for body, at in places.values()])


def _tracked(model: mujoco.MjModel, states: Array, places: Places) -> Array:
    """Return where points are at states, (n, k, 3) in [m]."""
    data, result = mujoco.MjData(model), []
    for state in states:
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        result.append(_points(data, places))
    return np.array(result)
