"""The way of an assembly over a range of the crank, by a few steps of MuJoCo in C."""

import copy

import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.mjcf import Loops
from mechsim.simulation.profile import constant
from mechsim.simulation.settings import Settings
from mechsim.simulation.step import step

Array = NDArray[np.float64]
TURN = 2.0 * np.pi

# fourth-order steps a turn, after which poses lie within 1e-4 of where they belong, and splines through
# them within one Newton step: measured 2e-7 to 1e-4 over the catalogue
STEPS = 64
# a correction longer than this may lead elsewhere; it has to be well above those and below any way there
ASTRAY = 1e-3


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
    turned = end - angle
    count = int(np.ceil(abs(turned) / TURN * STEPS))
    jacobian = loops.linearise(start[None])[1]
    side = float(loops.side(jacobian)[0])
    if side == 0.0:
        return None
    sense = float(np.sign(turned))
    begin = start, sense * loops.tangent(jacobian)[0]
    runner = copy.copy(loops)
    runner.model = copy.copy(loops.model)
    profile = constant(sense, abs(turned) / TURN, angle)
    steps = step(runner, Settings(steps_per_turn=STEPS), profile, begin, count, 1)
    if steps.diverged:
        return None
    rough = steps.states.qpos[1:]
    rough[:, loops.crank_place] = angle + turned * np.arange(1.0, count + 1.0) / count
    rough[-1, loops.crank_place] = end
    try:
        closed = loops.close(rough, most_steps=4)
    except (AssemblyError, FloatingPointError):
        return None
    sides = loops.side(loops.linearise(closed)[1])
    certain = np.abs(closed - rough).max() < ASTRAY and (sides == side).all()
    return closed if certain else None
