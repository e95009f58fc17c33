"""Whole revolutions of the crank: whether they lead back, and the state some revolutions away."""

from collections.abc import Iterator

import numpy as np

from mechsim.numerics.angles import REVOLUTION, other_revolutions
from mechsim.numerics.arrays import Array
from mechsim.simulation import closing
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.state import hinge_entries, quaternion_entries

# distance between states before and after a revolution, in [rad] or characteristic lengths, that is rounding
RETURN_TOLERANCE = 1e-9
# change of the residuals, in [rad], below which the pose is the same
MAX_RESIDUAL_CHANGE = 1e-9


def revolution_gain(loops: ModelLoops, states: Array) -> Array | None:
    """Return the change of a state by a revolution of the crank, (nq,); None where it does not lead back."""
    ends = closing.close(loops, states[[0, -1]])
    gain = np.where(quaternion_entries(loops.model), 0.0, ends[1] - ends[0])
    whole_turns = np.where(hinge_entries(loops.model), REVOLUTION * np.round(gain / REVOLUTION), 0.0)
    # a link with ball joints may have spun, but the points on its axis must return
    positions = point_positions(loops, ends)
    returns = (
        np.abs(positions[1] - positions[0]).max(initial=0.0) < RETURN_TOLERANCE * loops.characteristic_length
    )
    return whole_turns if returns and np.abs(gain - whole_turns).max() < RETURN_TOLERANCE else None


def point_positions(loops: ModelLoops, states: Array) -> Array:
    """Return the positions of all sites and loop-closing points at n states, (n, k, 3) in [m]."""
    position, rotation = loops.posed.body_poses(states)
    ends = [end for pair in loops.pairs for end in pair.ends]
    points = [(position[:, body] + rotation[:, body] @ local)[:, None] for body, local in ends]
    return np.concatenate([*points, loops.posed.site_positions(states)], 1)


def on_other_revolutions(loops: ModelLoops, state: Array, angles: Array) -> Iterator[Array]:
    """Yield a closed state (nq,) at crank angles within a revolution of the given ones, (n,).

    There is none where a gear makes the pose differ after a revolution of the crank, or under motion laws.
    """
    for revolutions in other_revolutions(float(state[loops.crank_address]), angles):
        shifted = _shifted(loops, state, revolutions)
        if shifted is not None:
            yield shifted


def _shifted(loops: ModelLoops, state: Array, revolutions: int) -> Array | None:
    """Return the state with revolutions added to the crank angle; None where that is another pose."""
    if loops.drivers is not None:
        return None
    shifted = state.copy()
    shifted[loops.crank_address] += revolutions * REVOLUTION
    for coupling in loops.couplings:
        driven = coupling.left.addresses
        if len(driven) > 1 or not hinge_entries(loops.model)[driven].all():
            continue
        gain = coupling.target(shifted[None]) - coupling.target(state[None])
        shifted[driven] += REVOLUTION * np.round(gain / coupling.left.weights / REVOLUTION)
    residual_change = loops.closure_error(loops.residual(shifted[None]) - loops.residual(state[None]))
    return shifted if residual_change.max() < MAX_RESIDUAL_CHANGE else None
