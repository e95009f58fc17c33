"""MuJoCo Warp, in float32, on the device that Warp prefers; it is made for many worlds on a GPU."""

import time

import mujoco_warp as mjw
import numpy as np
import warp as wp
from by_mujoco import RK4, Options, configured, initial
from reference_problem import Poses, Problem, Setting

NAME, PACKAGE = "MuJoCo Warp", "mujoco-warp"
SETTINGS = [
    Setting("default", 0.002, Options()),
    Setting("as mechsim writes it", -5.0, Options(RK4, "mechsim")),
]


def run(problem: Problem, setting: Setting) -> Poses:
    wp.config.quiet = True
    model, steps = configured(problem, setting), setting.steps(problem.interval)
    data, on_device = initial(problem, model), mjw.put_model(model)
    mjw.step(on_device, mjw.put_data(model, data))  # the kernels are compiled before the time is taken
    state = mjw.put_data(model, data)
    qpos, torque, seconds = np.empty((problem.instants, model.nq)), np.empty(problem.instants), 0.0
    for k in range(problem.instants):
        before = time.process_time()
        for _ in range(steps):
            mjw.step(on_device, state)
        qpos[k] = state.qpos.numpy()[0]
        seconds += time.process_time() - before
        mjw.forward(on_device, state)
        torque[k] = -problem.flywheel * state.qacc.numpy()[0, model.jnt_dofadr[problem.crank]]
    return problem.poses(qpos, torque, seconds)
