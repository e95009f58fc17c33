"""Where the links of a mechanism go as its crank turns, by its own model: for pictures only."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from mechsim.errors import AssemblyError
from mechsim.mechanism import GROUND, IDENTITY, Mechanism, Pose
from mechsim.mjcf.compiled import compiled
from mechsim.mjcf.generate import generate
from mechsim.mjcf.loops import Loops
from mechsim.scene import Scene

Array = NDArray[np.float64]

# crank angles tried in a turn
STEPS = 48


def swept(mechanism: Mechanism) -> dict[str, Pose]:
    """Return the poses of all links, ground included, over the turn or as far as the crank can go.

    Links other than the ground have as many poses as there are crank angles. Where the loops close
    nowhere, the one pose is the model's reference configuration.
    """
    model = compiled(generate(mechanism, Scene(level="pose"), mechanism.guess))
    loops = Loops(model)
    start = model.qpos0.copy()
    start[loops.crank_place] = mechanism.start
    ahead = _states(loops, start, 2.0 * np.pi / STEPS)
    states = ahead if len(ahead) >= STEPS else ahead + _states(loops, start, -2.0 * np.pi / STEPS)
    return {GROUND: IDENTITY, **_poses(mechanism, model, states or [model.qpos0])}


def _states(loops: Loops, start: Array, step: float) -> list[Array]:
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
        rough[loops.crank_place] += step
    return states


def _poses(mechanism: Mechanism, model: mujoco.MjModel, states: list[Array]) -> dict[str, Pose]:
    data = mujoco.MjData(model)
    names = [link.name for link in mechanism.links]
    places, rotations = np.empty((len(names), len(states), 3)), np.empty((len(names), len(states), 3, 3))
    for i, state in enumerate(states):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        for k, name in enumerate(names):
            places[k, i], rotations[k, i] = data.body(name).xpos, data.body(name).xmat.reshape(3, 3)
    return {name: Pose(places[k], rotations[k]) for k, name in enumerate(names)}
