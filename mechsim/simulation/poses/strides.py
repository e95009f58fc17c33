"""The path of an assembly by strides short enough that each is shown to stay in it."""

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.maths.arrays import Array
from mechsim.simulation.model_loops import ModelLoops

# the crank's longest stride
STRIDE = 2.0 * np.pi / 16
# a walk that needs strides below this stands at a dead centre; what lies nearer needs no walk
SHORTEST = 1e-14
# opening of the loops, in units of the stride squared, from which one Newton step leaves an opening
# far below what the next stride is judged by
LOOSE, ROUNDING, MOST_STEPS = 0.05, 1e-13, 8
# a correction longer than this part of the stride may have fallen into the other assembly
SAFE = 0.25


def walk(loops: ModelLoops, start: Array, end: float) -> list[Array]:
    """Return nearly closed states on the path from a closed state to a crank angle, the last one there.

    Raises:
        AssemblyError: at the crank angle beyond which the loops cannot close in this assembly.
    """
    here, stride = start[None], STRIDE
    angle = float(start[loops.crank_place])
    sense = 1.0 if end > angle else -1.0
    jacobian = loops.linearise(here)[1]
    slope, side = loops.tangent(jacobian), loops.side(jacobian)
    bend = np.zeros_like(slope)
    found: list[Array] = []
    while sense * (end - angle) > SHORTEST:
        left = abs(end - angle)
        # a stride a tenth longer saves a last one that would be next to nothing
        step = left if left < 1.1 * stride else stride
        target = end if step == left else angle + sense * step
        guess = loops.moved(here, sense * step * slope + 0.5 * step**2 * bend)
        guess[0, loops.crank_place] = target
        there = _landed(loops, here, guess, side)
        if there is None:
            # what is left open of the last pose weighs the more the shorter the stride
            here = loops.close(here)
            slope, bend = loops.tangent(loops.linearise(here)[1]), np.zeros_like(slope)
            stride = step / 2.0
            if stride < SHORTEST:
                raise AssemblyError(
                    f"{loops.name}: the crank cannot pass {angle:.7g} rad in this assembly; "
                    "stay on this side of the dead centre or change the dimensions"
                )
            continue
        here, slope_there = there
        bend = sense * (slope_there - slope) / step
        slope, angle = slope_there, target
        found.append(here[0])
        stride = min(2.0 * step, STRIDE)
    return found


def _landed(loops: ModelLoops, here: Array, guess: Array, side: Array) -> tuple[Array, Array] | None:
    """Return the state that a guess leads to, and its slope; None if that may be another assembly."""
    there = guess
    step_of_crank = float(guess[0, loops.crank_place] - here[0, loops.crank_place])
    for _ in range(MOST_STEPS):
        residual, jacobian = loops.linearise(there)
        try:
            step, slope = loops.newton(residual, jacobian)
        except (np.linalg.LinAlgError, FloatingPointError):
            return None
        there = loops.moved(there, step)
        if np.abs(there - guess).max() > SAFE * np.abs(here - guess).max():
            return None
        if loops.gap(residual)[0] < max(LOOSE * step_of_crank**2, ROUNDING):
            # the last step may have crossed over, too
            landed = loops.side(loops.linearise(there)[1])
            return None if min(loops.side(jacobian) * side, landed * side) < 0.0 else (there, slope)
    return None
