"""The runs that make the reference of a model without a closed form: as fine as a budget has time for."""

from collections.abc import Sequence
from dataclasses import dataclass
from time import process_time

import numpy as np

from mechsim.errors import InputError
from mechsim.model.motion import Motion
from mechsim.simulation import Settings
from mechsim.studies.tradeoff.built_model import BuiltModel
from mechsim.studies.tradeoff.pace import BEYOND, Budget, Pace

# steps a turn of the runs, and what they may be divided by where that would take more than this part of the
# budget that is left
FINE, COARSER, REFERENCE_PART = (3600, 7200, 14400), (1, 2, 5, 10, 25, 50), 0.4
# a first trial that takes less of the budget than this is made again, as it paid for what is loaded then
TRIAL_PART = 0.05


@dataclass(frozen=True, slots=True)
class Affordable:
    """What a budget has time for.

    Attributes:
        steps: a turn of the runs, rising; the finest are `FINE`.
        enough: a budget for the finest in [s]; None where these are they.
    """

    steps: Sequence[int] = FINE
    enough: float | None = None


def reference_runs(built: BuiltModel, name: str, budget: Budget | None) -> dict[int, Motion]:
    """Return steps a turn -> motion, rising; the finest is run first, as the others are nothing without it.

    Args:
        built: the model.
        name: what it is called.
        budget: what all may take; None for the finest runs.

    Raises:
        InputError: where a run diverges, or the budget has no time for the coarsest.
    """
    can = Affordable() if budget is None else affordable(built, name, budget)
    runs: dict[int, Motion] = {}
    for count in reversed(can.steps):
        motion, _ = built.motion(Settings(steps_per_turn=count))
        if motion is None:
            raise InputError(_diverging(name, count, tuple(runs), can.enough))
        runs[count] = motion
    return dict(reversed(runs.items()))


def affordable(built: BuiltModel, name: str, budget: Budget) -> Affordable:
    """Return the finest runs that a part of the budget has time for.

    Raises:
        InputError: where it has none for the coarsest.
    """
    budget.require(name)
    pace, coarse = Pace(), Settings(steps_per_turn=min(FINE) // max(COARSER))
    for _ in range(2):
        begun, left = process_time(), budget.left
        seconds = built.motion(coarse)[1]
        pace.learn(built.build, coarse, built.profile.turns, seconds, process_time() - begun)
        budget.require(name)
        if left - budget.left > TRIAL_PART * budget.seconds:
            break
    tried = [tuple(count // part for count in FINE) for part in COARSER]
    needed = [
        sum(pace.trial(built.build, Settings(steps_per_turn=count), built.profile.turns) for count in steps)
        for steps in tried
    ]
    for steps, seconds in zip(tried, needed, strict=True):
        if seconds <= REFERENCE_PART * budget.left:
            return Affordable(steps, None if steps == FINE else _enough(budget, needed[0]))
    if needed[-1] <= budget.left + BEYOND * budget.seconds:
        return Affordable(tried[-1], _enough(budget, needed[0]))
    raise InputError(
        f"{name} took {budget.spent:.2g} s to load, build and try, and the coarsest reference takes "
        f"{needed[-1]:.2g} s more, but the budget is {budget.seconds:g} s; "
        f"give --budget {_enough(budget, needed[-1]):g}s or more"
    )


def _enough(budget: Budget, needed: float) -> float:
    """Return a budget in [s], of which runs that need so much time are the part they may be."""
    return float(np.ceil(budget.spent + budget.kept + needed / REFERENCE_PART))


def _diverging(name: str, count: int, held: Sequence[int], enough: float | None) -> str:
    """Return that a run diverges, and what may help: finer runs, where there are any."""
    said = f"{name} diverges at {count:,} steps a turn with {Settings().integrator}"
    said += f", though not at {held[-1]:,}" if held else ""
    damp = "less stiffness, or more damping or mass, in what moves"
    told = damp if enough is None else f"--budget {enough:g}s has time for up to {max(FINE):,}"
    told += f"; else {damp}" if enough is not None and not held else ""
    return f"{said}, so that no reference run can be made; what may help: {told}"
