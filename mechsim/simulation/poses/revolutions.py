"""The same pose counted on another lap of the crank: a turn changes the number, not the linkage."""

from collections.abc import Iterator

import numpy as np

from mechsim.numerics.angles import TURN, other_laps
from mechsim.numerics.arrays import Array
from mechsim.simulation.model_loops import ModelLoops

# a gear this near to whole turns, in [rad], stands as it did
WHOLE = 1e-9


def on_other_laps(loops: ModelLoops, state: Array, angles: Array) -> Iterator[Array]:
    """Yield a closed state (nq,) as it is on other laps, from which crank angles (n,) lie within a turn.

    Where a gear makes the linkage another one after a turn of the crank, or programs move it, there is none.
    """
    for laps in other_laps(float(state[loops.crank_address]), angles):
        counted = _counted(loops, state, laps)
        if counted is not None:
            yield counted


def _counted(loops: ModelLoops, state: Array, laps: int) -> Array | None:
    """Return the state with turns added to the crank's count; None where that is another pose."""
    if loops.drivers is not None:
        return None
    counted = state.copy()
    counted[loops.crank_address] += laps * TURN
    for coupling in loops.couplings:
        driven = coupling.left.addresses
        if len(driven) > 1 or not loops.hinges[driven].all():
            continue
        gain = coupling.target(counted[None]) - coupling.target(state[None])
        counted[driven] += TURN * np.round(gain / coupling.left.weights / TURN)
    opened = loops.closure_error(loops.residual(counted[None]) - loops.residual(state[None]))
    return counted if opened.max() < WHOLE else None
