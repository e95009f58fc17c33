"""A path predicted by explicit steps of MuJoCo, checked to stay in the assembly."""

import copy
from dataclasses import replace
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from mujoco import batch

from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.simulation import loop_jacobian
from mechsim.simulation.mjcf import quiet
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.settings import Settings

# fourth-order steps per revolution, with errors of poses below 1e-4: measured 2e-6 to 2e-5 over the catalogue
STEPS = 48
STEP_TIME = REVOLUTION / STEPS
# error of a pose above which it may leave the assembly; well above the measured errors and below any distance
# between assemblies
MAX_ERROR = 1e-3
# ratio of a determinant to those two steps on either side, below which it may have a double zero between:
# with one it grows as the square of the distance, and the ratio is a ninth at most
MIN_DETERMINANT_RATIO = 0.25
# maximum number of steps, for memory
MAX_STEPS = 1_000_000


@quiet()
def explicit_trace(loops: ModelLoops, start: Array, end: float, jacobian: Array) -> Array | None:
    """Return nearly closed states, (n, nq), on the path from a closed one to a crank angle.

    None where it is not certain that they stay in the assembly: loops do not close, or the sign of the
    determinant changes or is unknown.

    Args:
        loops: of the model, which is not changed.
        start: closed state, (nq,).
        end: crank angle in [rad].
        jacobian: of the loops at the start, (1, m, nv).
    """
    angle = float(start[loops.crank_address])
    count = int(np.ceil(abs(end - angle) / STEP_TIME))
    sign = float(loop_jacobian.determinant_sign(loops, jacobian)[0])
    if sign == 0.0 or count > MAX_STEPS:
        return None
    speed = (end - angle) / (count * STEP_TIME)
    states = _stepped(loops, start, speed * loop_jacobian.tangent(loops, jacobian)[0], count)
    angles = np.linspace(angle, end, count + 1)[1:]
    # MuJoCo resets a bad state to the initial one
    if not np.abs(states[:, loops.crank_address] - angles).max() < MAX_ERROR:
        return None
    states[:, loops.crank_address] = angles
    residual, jacobian = loops.linearise(states)
    same_sign = (loop_jacobian.determinant_sign(loops, jacobian) == sign).all()
    if not (loops.closure_error(residual).max() < MAX_ERROR and same_sign):
        return None
    return None if _may_branch(np.abs(loop_jacobian.determinant(loops, jacobian))) else states


def _may_branch(determinants: Array) -> bool:
    """Return whether assemblies may coincide between states: the determinant may have a double zero."""
    neighbours = np.minimum(determinants[:-4], determinants[4:])
    return bool((determinants[2:-2] < MIN_DETERMINANT_RATIO * neighbours).any())


def _stepped(loops: ModelLoops, start: Array, rates: Array, count: int) -> Array:
    """Return the unchecked states after each step of `STEP_TIME` at the crank's rate, (count, nq)."""
    if loops not in _runners:
        _runners[loops] = _runner(loops)
    sims = _runners[loops]
    sims.reset(stage=int(mujoco.mjtStage.mjSTAGE_NONE))
    sims.bind("qpos")[:], sims.bind("qvel")[:] = start, rates
    return sims.rollout(count, record=("qpos",))["qpos"][0]


# one simulation per model: creating one takes as long as stepping it for a revolution
_runners: WeakKeyDictionary[ModelLoops, batch.Batch] = WeakKeyDictionary()


def _runner(loops: ModelLoops) -> batch.Batch:
    """Return a simulation of the model with stiff loops and virtual drive inertia."""
    hard = replace(loops, model=copy.copy(loops.posed.kinematic_model))
    hard.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    Settings(steps_per_turn=STEPS).apply(hard, STEP_TIME)
    return batch.Batch(hard.model, 1, 1)
