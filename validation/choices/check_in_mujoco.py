"""Errors of a tuned file by plain MuJoCo, without the loop equations and runs of mechsim.

The written Python script steps the file with `mj_step`. For the closure error, Newton's method on MuJoCo's
rows of equality constraints closes each state at the same driver positions. For the trajectory error, the
reference is the same file with smaller steps and time constants of loops.
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
TrackedPoints = Mapping[str, tuple[int, Array]]
# largest number of compared states; Newton steps; tolerance of closure in [m] or [rad]; rank tolerance
STATES, STEPS, CLOSED, RANK = 1500, 12, 1e-9, 1e-9
# factors of the smaller steps: of the reference, and of the run that estimates its error
FINE_FACTOR, COARSE_FACTOR = 16, 8


def script_of(path: Path) -> ModuleType:
    """Return the script that was written with a file, as a module."""
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


def closure_error(
    script: ModuleType, duration: float, points: TrackedPoints, drivers: tuple[str, ...]
) -> float:
    """Return the largest distance of points from their positions in closed loops at the same drivers, in [m].

    Infinite for a non-finite state, or if no closed state is near.

    Args:
        script: module that steps the file.
        duration: in [s].
        points: body and position in its frame of each point.
        drivers: locked joints.
    """
    model = _only_equalities(script.model)
    _, states = states_of(script, duration)
    if not np.isfinite(states).all():
        return np.inf
    locked = {int(model.joint(name).dofadr[0]) for name in drivers}
    free = np.array([i for i in range(model.nv) if i not in locked])
    data, worst = mujoco.MjData(model), 0.0
    for state in states[:: max(1, len(states) // STATES)]:
        data.qpos[:] = state
        mujoco.mj_fwdPosition(model, data)
        before = _points(data, points)
        if not _project(model, data, free):
            return np.inf
        worst = max(worst, float(np.linalg.norm(_points(data, points) - before, axis=1).max()))
    return worst


def trajectory_error(script: ModuleType, duration: float, points: TrackedPoints) -> tuple[float, float]:
    """Return the largest distance of points from a run of small steps, and the error of that run."""
    model, step = script.model, float(script.model.opt.timestep)
    constants = model.eq_solref[:, 0].copy()
    _, states = states_of(script, duration)
    model.opt.iterations, model.opt.tolerance = 100, 1e-4 * min(model.opt.tolerance or 1e-20, 1e-8)
    runs: list[Array] = []
    for factor in (COARSE_FACTOR, FINE_FACTOR):
        model.opt.timestep = step / factor
        model.eq_solref[:, 0] = np.where(constants > 0.0, constants / factor, constants)
        runs.append(_tracked(model, states_of(script, duration)[1][factor - 1 :: factor], points))
    tracked = _tracked(model, states, points)
    count = min(len(tracked), *(len(run) for run in runs))
    coarse, fine = (run[:count] for run in runs)
    error = np.linalg.norm(tracked[:count] - fine, axis=2).max()
    return float(error), float(np.linalg.norm(fine - coarse, axis=2).max())


def _only_equalities(model: mujoco.MjModel) -> mujoco.MjModel:
    """Return a copy with equalities as the only constraints."""
    disable = mujoco.mjtDisableBit
    model = copy.copy(model)
    model.opt.disableflags |= int(disable.mjDSBL_CONTACT | disable.mjDSBL_LIMIT | disable.mjDSBL_FRICTIONLOSS)
    model.opt.jacobian = int(mujoco.mjtJacobian.mjJAC_DENSE)
    return model


def _project(model: mujoco.MjModel, data: mujoco.MjData, free: NDArray[np.int_]) -> bool:
    """Project a state onto the nearest closed one; return whether it exists."""
    for _ in range(STEPS):
        residual, jacobian = data.efc_pos[: data.nefc], data.efc_J.reshape(-1, model.nv)[: data.nefc]
        step = np.zeros(model.nv)
        step[free] = -np.linalg.pinv(jacobian[:, free], rcond=RANK) @ residual
        mujoco.mj_integratePos(model, data.qpos, step, 1.0)
        mujoco.mj_fwdPosition(model, data)
        if np.abs(step).max(initial=0.0) < CLOSED:
            break
    remaining = jacobian[:, free].T @ data.efc_pos[: data.nefc]
    return bool(np.isfinite(data.qpos).all() and np.abs(remaining).max(initial=0.0) < CLOSED)


def _points(data: mujoco.MjData, points: TrackedPoints) -> Array:
    """Return the positions of points, (k, 3) in [m]."""
    return np.array(
        [data.xpos[body] + data.xmat[body].reshape(3, 3) @ position for body, position in points.values()]
    )


def _tracked(model: mujoco.MjModel, states: Array, points: TrackedPoints) -> Array:
    """Return the positions of points at states, (n, k, 3) in [m]."""
    data, result = mujoco.MjData(model), []
    for state in states:
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        result.append(_points(data, points))
    return np.array(result)
