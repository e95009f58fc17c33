"""The same pose counted on another lap of the crank: a turn changes the number, not the linkage."""

from collections.abc import Iterator

import numpy as np

from mechsim.maths.angles import TURN, other_laps
from mechsim.maths.arrays import Array
from mechsim.simulation.model_loops import ModelLoops

# a gear this near to whole turns, in [rad], stands as it did
WHOLE = 1e-9


def on_other_laps(loops: ModelLoops, state: Array, angles: Array) -> Iterator[Array]:
    """Yield a closed state (nq,) as it is on other laps, from which crank angles (n,) lie within a turn.

    Where a gear makes the linkage another one after a turn of the crank, there is none.
    """
    for laps in other_laps(float(state[loops.crank_place]), angles):
        counted = _counted(loops, state, laps)
        if counted is not None:
            yield counted


def _counted(loops: ModelLoops, state: Array, laps: int) -> Array | None:
    """Return the state with turns added to the crank's count; None where that is another pose."""
    counted = state.copy()
    counted[loops.crank_place] += laps * TURN
    for coupling in loops.couplings:
        driven, driver = coupling.places
        if driver < 0:
            continue
        curve = np.polynomial.Polynomial(coupling.polynomial)
        gain = float(curve(counted[driver] - coupling.zeros[1]) - curve(state[driver] - coupling.zeros[1]))
        counted[driven] += TURN * np.round(gain / TURN) if loops.hinges[driven] else 0.0
    opened = loops.gap(loops.residual(counted[None]) - loops.residual(state[None]))
    return counted if opened.max() < WHOLE else None
