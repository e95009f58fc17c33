"""The poses of all links over the whole turn of a crank, or as far round as it can go."""

import numpy as np

from mechsim.errors import AssemblyError
from mechsim.model.links import GROUND, IDENTITY, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.model.scene import Scene
from mechsim.numerics.arrays import Array
from mechsim.simulation.closed_model import initial_guess, link_poses
from mechsim.simulation.model_loops import ModelLoops

# crank angles in a turn
STEPS = 48


def swept(mechanism: Mechanism) -> dict[str, Pose]:
    """Return the poses of all links, ground included, over the turn or as far as the crank can go.

    Links other than the ground have as many poses as there are crank angles. Where the loops close
    nowhere, the one pose is the model's reference configuration.
    """
    loops, start = initial_guess(mechanism, Scene(level="pose"))
    ahead = _states(loops, start, 2.0 * np.pi / STEPS)
    states = ahead if len(ahead) >= STEPS else ahead + _states(loops, start, -2.0 * np.pi / STEPS)
    found = np.array(states or [loops.model.qpos0])
    return {GROUND: IDENTITY, **link_poses(mechanism, loops.model, found)}


def _states(loops: ModelLoops, start: Array, step: float) -> list[Array]:
    """Closed states from a rough one on, the crank turning by a step each time; as far as it can."""
    states: list[Array] = []
    rough = start
    for _ in range(STEPS):
        try:
            closed = loops.close(rough[None])[0]
        except AssemblyError:
            break
        states.append(closed)
        rough = closed.copy()
        rough[loops.crank_address] += step
    return states
