"""Engines that step an MJCF model: MuJoCo in C, and MJWarp where it is installed.

Each takes a compiled model, an initial state and a number of steps. It returns the coordinates after every
step and the processor time of the steps alone; kernels are compiled before.
"""

import time
from collections.abc import Callable
from importlib.util import find_spec

import mujoco
import numpy as np
from mujoco import batch

Array = np.ndarray
# model, qpos (nq,), qvel (nv,), steps, constant ctrl (nu,) -> qpos after each step (steps, nq), seconds
Engine = Callable[[mujoco.MjModel, Array, Array, int, Array], tuple[Array, float]]


def by_c(model: mujoco.MjModel, qpos: Array, qvel: Array, steps: int, ctrl: Array) -> tuple[Array, float]:
    """Step with MuJoCo, in float64."""
    sims = batch.Batch(model, 1, 1)
    sims.bind("qpos")[:], sims.bind("qvel")[:] = qpos, qvel
    sims.bind("ctrl")[:] = ctrl
    before = time.process_time()
    out = sims.rollout(steps, record=("qpos",))
    return out["qpos"][0], time.process_time() - before


def by_warp(model: mujoco.MjModel, qpos: Array, qvel: Array, steps: int, ctrl: Array) -> tuple[Array, float]:
    """Step with MJWarp, in float32, on the device that Warp prefers: a GPU, else the CPU."""
    import mujoco_warp as mjw
    import warp as wp

    wp.config.quiet = True
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
    mujoco.mj_forward(model, data)
    device_model = mjw.put_model(model)
    mjw.step(device_model, mjw.put_data(model, data))
    state = mjw.put_data(model, data)
    result = np.empty((steps, model.nq))
    before = time.process_time()
    for row in result:
        mjw.step(device_model, state)
        row[:] = state.qpos.numpy()[0]
    return result, time.process_time() - before


# engine -> module, function that steps
ENGINES: dict[str, tuple[str, Engine]] = {
    "MuJoCo C": ("mujoco", by_c),
    "MJWarp": ("mujoco_warp", by_warp),
}


def installed() -> tuple[dict[str, Engine], list[str]]:
    """Return the installed engines, and a message for each that is missing."""
    engines = {name: engine for name, (module, engine) in ENGINES.items() if find_spec(module)}
    messages = [
        f"{name} is not installed and skipped: pip install -e '.[engines]'"
        for name in ENGINES
        if name not in engines
    ]
    return engines, messages
