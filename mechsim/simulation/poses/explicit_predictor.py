"""The path of an assembly by a few steps of MuJoCo in C: rough, and checked for having stayed in it."""

import copy
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from mujoco import batch

from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf import quiet
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.settings import Settings

# fourth-order steps a turn, after which poses lie within 1e-4 of where they belong: measured 2e-6 to
# 2e-5 over the catalogue
STEPS = 48
CLOCK = TURN / STEPS
# a pose farther than this from where it belongs may be about to leave the assembly; well above those, and
# below any distance to another
ASTRAY = 1e-3
# part of what a determinant is two steps on either side below which it touches nought between: where it does,
# by the square of the distance, it is a ninth at the most
TOUCHED = 0.25
# steps in one go: what their states need of memory
MOST = 1_000_000


@quiet()
def sprint(loops: ModelLoops, start: Array, end: float, jacobian: Array) -> Array | None:
    """Return nearly closed states, (n, nq), on the path from a closed one to a crank angle, the last there.

    None where it is not certain that they stay in the assembly: loops that open, a state on the other
    side of a dead centre, or on a side that is not known.

    Args:
        loops: of the model, which stays as it is.
        start: closed state, (nq,).
        end: crank angle in [rad].
        jacobian: of the loops at the start, (1, m, nv).
    """
    angle = float(start[loops.crank_address])
    count = int(np.ceil(abs(end - angle) / CLOCK))
    side = float(loops.determinant_sign(jacobian)[0])
    if side == 0.0 or count > MOST:
        return None
    states = _stepped(loops, start, (end - angle) / (count * CLOCK) * loops.tangent(jacobian)[0], count)
    asked = np.linspace(angle, end, count + 1)[1:]
    # MuJoCo sets a bad state back to where it began
    if not np.abs(states[:, loops.crank_address] - asked).max() < ASTRAY:
        return None
    states[:, loops.crank_address] = asked
    residual, jacobian = loops.linearise(states)
    stays = loops.closure_error(residual).max() < ASTRAY and (loops.determinant_sign(jacobian) == side).all()
    return states if stays and not _touched(np.abs(loops.determinant(jacobian))) else None


def _touched(size: Array) -> bool:
    """Say whether pairs of assemblies may meet between states: the determinant touches nought."""
    beside = np.minimum(size[:-4], size[4:])
    return bool((size[2:-2] < TOUCHED * beside).any())


def _stepped(loops: ModelLoops, start: Array, rates: Array, count: int) -> Array:
    """Return the states after each step of `CLOCK` at the crank's rate, (count, nq), wherever they lead."""
    if loops not in _runners:
        _runners[loops] = _runner(loops)
    sims = _runners[loops]
    sims.reset(stage=int(mujoco.mjtStage.mjSTAGE_NONE))
    sims.bind("qpos")[:], sims.bind("qvel")[:] = start, rates
    return sims.rollout(count, record=("qpos",))["qpos"][0]


# a model is often asked for several ranges: making a simulation takes as long as stepping it for a turn
_runners: WeakKeyDictionary[ModelLoops, batch.Batch] = WeakKeyDictionary()


def _runner(loops: ModelLoops) -> batch.Batch:
    """Return a simulation of the model with hard loops and a flywheel."""
    hard = copy.copy(loops)
    hard.model = copy.copy(loops.posed.kinematic_model)
    hard.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    Settings(steps_per_turn=STEPS).apply(hard, CLOCK)
    return batch.Batch(hard.model, 1, 1)
