"""MuJoCo in C, in doubles."""

import copy
import time
from dataclasses import dataclass
from itertools import product
from typing import Literal

import mujoco
import numpy as np
from reference_problem import Array, Poses, Problem, Setting

NAME, PACKAGE = "MuJoCo", "mujoco"
EULER, RK4 = mujoco.mjtIntegrator.mjINT_EULER, mujoco.mjtIntegrator.mjINT_RK4
# what mechsim writes: a solimp near 1; MuJoCo's `stiff` time constant is two steps
IMPEDANCE = (0.9999, 0.9999, 0.001, 0.5, 2.0)


@dataclass(frozen=True)
class Options:
    """Integrator, and constraints as MuJoCo's defaults, as mechsim writes them, or with a stiff reference."""

    integrator: mujoco.mjtIntegrator = EULER
    loops: Literal["default", "mechsim", "two steps"] = "default"


def _name(options: Options) -> str:
    return f"{options.integrator.name[6:]}, loops: {options.loops}"


GRID = [Options(*choice) for choice in product((EULER, RK4), ("default", "mechsim", "two steps"))]
SETTINGS = [
    Setting("default", 0.002, Options()),
    *[Setting(_name(options), -float(n), options) for options in GRID for n in (5, 25)],
]


def configured(problem: Problem, setting: Setting) -> mujoco.MjModel:
    """Return the model with a setting."""
    options = setting.options
    model = copy.copy(problem.written if options.loops == "mechsim" else problem.model)
    model.opt.integrator = options.integrator
    model.opt.timestep = problem.interval / setting.steps(problem.interval)
    if options.loops == "two steps":
        model.eq_solref[:] = 2.0 * model.opt.timestep, 1.0
        model.eq_solimp[:] = IMPEDANCE
    return model


def initial(problem: Problem, model: mujoco.MjModel) -> mujoco.MjData:
    """Return the state at the start."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = problem.qpos, problem.qvel
    mujoco.mj_forward(model, data)
    return data


def run(problem: Problem, setting: Setting) -> Poses:
    model = configured(problem, setting)
    data, steps = initial(problem, model), setting.steps(problem.interval)
    qpos: Array = np.empty((problem.instants, model.nq))
    torque, seconds = np.empty(problem.instants), 0.0
    crank = model.jnt_dofadr[problem.crank]
    for k in range(problem.instants):
        before = time.process_time()
        mujoco.mj_step(model, data, steps)
        seconds += time.process_time() - before
        qpos[k] = data.qpos
        # the acceleration at this instant: mj_step leaves that of the one before
        mujoco.mj_forward(model, data)
        torque[k] = -problem.flywheel * data.qacc[crank]
    return problem.poses(qpos, torque, seconds)
