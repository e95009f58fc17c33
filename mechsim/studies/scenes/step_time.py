"""What a simulated second takes, measured fairly: in rounds, one after the other, medians of each."""

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.studies.scenes.scene_run import stepped
from mechsim.studies.scenes.user_scene import UserScene

# of processor time that a run is to take at least, in [s]: clocks tell no less
LEAST = 0.01
# runs of a short motion in a round, at most, unless the clock tells nothing of them
MOST = 8
ROUNDS = 5


def step_times(
    runs: Sequence[tuple[UserScene, mujoco.MjModel]],
    rounds: int = ROUNDS,
    tell: Callable[[float], None] = lambda _: None,
) -> Array:
    """Return the processor time of a simulated second of each model, (models,) in [s].

    In each round every model is run once, in a new order, so that a slow minute of the machine falls on all;
    what counts is the median of the rounds.

    Args:
        runs: scenes, and models with which they run.
        rounds: how many.
        tell: told what part is done.
    """
    random = np.random.default_rng(0)
    times = np.full((rounds + 1, len(runs)), np.nan)
    for number in range(rounds + 1):  # the first is thrown away: it fills the caches
        for i in random.permutation(len(runs)):
            times[number, i] = _once(*runs[i])
        tell((number + 1) / (rounds + 1))
    return np.median(times[1:], axis=0)


def _once(scene: UserScene, model: mujoco.MjModel) -> float:
    spent, simulated, runs = 0.0, 0.0, 0
    while not spent > 0.0 or (spent < LEAST and runs < MOST):
        runs += 1
        run = stepped(scene, model, records=2)
        if run.broken:
            return np.inf
        spent += run.seconds
        simulated += run.steps * float(model.opt.timestep)
    return spent / simulated
