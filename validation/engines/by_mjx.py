"""MuJoCo XLA on JAX: float32 as it comes, float64 where the setting says so."""

import time

import jax
import numpy as np
from by_mujoco import RK4, Options, configured, initial
from mujoco import mjx
from reference_problem import Poses, Problem, Setting

NAME, PACKAGE = "MJX", "mujoco-mjx"
DOUBLE = "float64, as mechsim writes it"
SETTINGS = [Setting("default", 0.002, Options()), Setting(DOUBLE, -20.0, Options(RK4, "mechsim"))]


def run(problem: Problem, setting: Setting) -> Poses:
    with jax.enable_x64(setting.name == DOUBLE):
        return _run(problem, setting)


def _run(problem: Problem, setting: Setting) -> Poses:
    model, steps = configured(problem, setting), setting.steps(problem.interval)
    on_device, state = mjx.put_model(model), mjx.put_data(model, initial(problem, model))

    @jax.jit
    def interval(state):  # type: ignore[no-untyped-def]
        return jax.lax.fori_loop(0, steps, lambda _, s: mjx.step(on_device, s), state)

    forward = jax.jit(lambda s: mjx.forward(on_device, s))
    jax.block_until_ready(interval(state))  # compiled before the time is taken
    qpos, torque, seconds = np.empty((problem.instants, model.nq)), np.empty(problem.instants), 0.0
    for k in range(problem.instants):
        before = time.process_time()
        state = jax.block_until_ready(interval(state))
        seconds += time.process_time() - before
        qpos[k] = state.qpos
        torque[k] = -problem.flywheel * float(forward(state).qacc[model.jnt_dofadr[problem.crank]])
    return problem.poses(qpos, torque, seconds)
