"""The time step for a tolerance of a free crank's angle, and the check that the run satisfies it.

The error estimate is the difference from a run with steps twice as long. If the error falls with nearly
fourth order, a tenth of that difference exceeds the error of the shorter steps. Otherwise the whole
difference counts.
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

# minimum steps per revolution in the first of three trials; each of the others doubles the steps
COARSEST = 60
# order with which the error is extrapolated if the observed order is at least as high; otherwise the whole
# change of the last halving counts
HIGH_ORDER = 3.4


@dataclass(frozen=True, slots=True)
class FreeStepping:
    """A free run at one time step.

    Attributes:
        steps: its recorded states.
        loops: of the model as stepped.
        settings: time-stepping settings.
        seconds: time spent stepping.
        every: number of records per sample.
    """

    steps: FreeSteps
    loops: ModelLoops
    settings: Settings
    seconds: float
    every: int


class LetRun(Protocol):
    """Function that runs a free mechanism at `steps` per revolution, recorded as at `steps / per_record`."""

    def __call__(self, steps: int, per_record: int = 1) -> FreeStepping: ...


def angle_within(let_run: LetRun, tolerance: float, least: float) -> tuple[FreeStepping, ToleranceReport]:
    """Return a run whose crank angle satisfies a tolerance, or the best run, and its tolerance report.

    Args:
        let_run: function that runs the mechanism.
        tolerance: of the crank angle at every instant, in [rad].
        least: minimum steps per revolution of the coarsest trial, for stability.
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
    """Return the largest difference between the crank angles of two runs at common instants, in [rad]."""
    if "diverged" in (coarse.steps.outcome, fine.steps.outcome):
        return np.inf
    address, n = fine.loops.crank_address, min(len(coarse.steps.time), len(fine.steps.time))
    return worst(fine.steps.qpos[:n, address] - coarse.steps.qpos[:n, address])
