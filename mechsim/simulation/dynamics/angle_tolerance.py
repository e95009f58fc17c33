"""The time step that a tolerance of a free crank's angle needs, and the proof that it keeps it.

Nothing but the run itself is asked: with steps twice as long the crank comes elsewhere. Where the error
falls nearly by the fourth order, a tenth of that difference is more than the shorter steps still err by;
else the whole of it counts.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mechsim.numerics.arrays import worst
from mechsim.numerics.convergence import plausible_order
from mechsim.simulation.dynamics.free_steps import FreeSteps
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.settings import Settings
from mechsim.simulation.tolerance import MAX_STEPS, Attempt, ToleranceReport, rounded, run_within_tolerance

# steps a turn of the coarsest of three trials, each with twice those before
COARSEST = 60
# an error that falls by this order or more is taken to fall by this order; else all that the last halving
# changed counts
HIGH_ORDER = 3.4


@dataclass(frozen=True, slots=True)
class FreeStepping:
    """A machine let run once.

    Attributes:
        steps: its records.
        loops: of the model as it was stepped.
        settings: how it was stepped.
        seconds: time spent stepping.
        every: how many records go to a sample.
    """

    steps: FreeSteps
    loops: ModelLoops
    settings: Settings
    seconds: float
    every: int


class LetRun(Protocol):
    """Lets the machine run with so many steps a turn; records as with a `per_record`-th part of them."""

    def __call__(self, steps: int, per_record: int = 1) -> FreeStepping: ...


def within(let_run: LetRun, tolerance: float, least: float) -> tuple[FreeStepping, ToleranceReport]:
    """Return a run whose crank angle keeps a tolerance in [rad], or the best there is; and its promise.

    Args:
        let_run: steps the machine.
        tolerance: on the crank angle at every instant, in [rad].
        least: steps a turn of the coarsest trial, so that stepping is stable.
    """
    coarsest = rounded(max(COARSEST, least), 2)
    first, second = let_run(coarsest), let_run(2 * coarsest, 2)
    before = 2 * coarsest, _apart(first, second)

    def attempt(steps: int) -> Attempt[FreeStepping]:
        nonlocal before
        if steps == 4 * coarsest:
            half, run, spent = second, let_run(steps, 4), 0
        else:
            half, run = let_run(steps // 2), let_run(steps, 2)
            spent = half.steps.steps
        change = _apart(half, run)
        order = plausible_order(before[1], change, steps / before[0])
        before = steps, change
        remaining = change / (2.0**HIGH_ORDER - 1.0) if order >= HIGH_ORDER else change
        return Attempt(
            run=run,
            steps=run.steps.steps,
            estimates={"halving": remaining},
            order=order,
            trials=spent,
            change=change,
        )

    spent = first.steps.steps + second.steps.steps
    return run_within_tolerance(attempt, tolerance, 4 * coarsest, _reason, trials=spent, multiple=2)


def _reason(steps: int, estimate: float) -> str:
    most = f"{MAX_STEPS} steps a turn, the most that are spent,"
    end = most if steps >= MAX_STEPS else f"{steps} steps a turn"
    return f"{end} leave the crank angle off by {estimate:.2g} rad; run fewer turns or allow more"


def _apart(coarse: FreeStepping, fine: FreeStepping) -> float:
    """Return how far two runs' crank angles are apart at the instants they share, in [rad]."""
    if "diverged" in (coarse.steps.outcome, fine.steps.outcome):
        return np.inf
    address, n = fine.loops.crank_address, min(len(coarse.steps.time), len(fine.steps.time))
    return worst(fine.steps.qpos[:n, address] - coarse.steps.qpos[:n, address])
