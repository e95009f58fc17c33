"""The way of an assembly over a range of the crank, by a few steps of MuJoCo in C."""

import copy
from weakref import WeakKeyDictionary

import mujoco
import numpy as np
from mujoco import batch
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.mjcf import Loops, quiet
from mechsim.simulation.settings import Settings

Array = NDArray[np.float64]
TURN = 2.0 * np.pi

# fourth-order steps a turn, after which poses lie within 1e-4 of where they belong, and splines through
# them within one Newton step: measured 2e-7 to 1e-4 over the catalogue
STEPS = 64
# a correction longer than this may lead elsewhere; it has to be well above those and below any way there
ASTRAY = 1e-3
CLOCK = TURN / STEPS


@quiet()
def sprint(loops: Loops, start: Array, end: float) -> Array | None:
    """Return closed states on the way from a closed state to a crank angle, (n, nq), the last one there.

    None where it is not certain that they stay in the assembly: a state that was not nearly closed,
    lies on the other side of a dead centre or on a side that is not known.

    Args:
        loops: of the model, which stays as it is.
        start: closed state, (nq,).
        end: crank angle in [rad].
    """
    angle = float(start[loops.crank_place])
    count = int(np.ceil(abs(end - angle) / CLOCK))
    jacobian = loops.linearise(start[None])[1]
    side = float(loops.side(jacobian)[0])
    if side == 0.0:
        return None
    rough = _stepped(loops, start, (end - angle) / (count * CLOCK) * loops.tangent(jacobian)[0], count)
    asked = np.linspace(angle, end, count + 1)[1:]
    # MuJoCo sets a bad state back to where it began
    if not np.abs(rough[:, loops.crank_place] - asked).max() < ASTRAY:
        return None
    rough[:, loops.crank_place] = asked
    try:
        closed = loops.close(rough, most_steps=4)
    except (AssemblyError, FloatingPointError):
        return None
    sides = loops.side(loops.linearise(closed)[1])
    certain = np.abs(closed - rough).max() < ASTRAY and (sides == side).all()
    return closed if certain else None


def _stepped(loops: Loops, start: Array, rates: Array, count: int) -> Array:
    """Return the states after each step of `CLOCK` at the crank's rate, (count, nq), wherever they lead."""
    if loops not in _runners:
        _runners[loops] = _runner(loops)
    sims = _runners[loops]
    sims.reset(stage=int(mujoco.mjtStage.mjSTAGE_NONE))
    sims.bind("qpos")[:], sims.bind("qvel")[:] = start, rates
    return sims.rollout(count, record=("qpos",))["qpos"][0]


# a model is often asked for several ranges: making a simulation takes as long as stepping it for a turn
_runners: WeakKeyDictionary[Loops, batch.Batch] = WeakKeyDictionary()


def _runner(loops: Loops) -> batch.Batch:
    """Return a simulation of the model with hard loops and a flywheel."""
    hard = copy.copy(loops)
    hard.model = copy.copy(loops.looking)
    hard.model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    Settings(steps_per_turn=STEPS).apply(hard, CLOCK)
    return batch.Batch(hard.model, 1, 1)
