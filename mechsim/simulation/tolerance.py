"""Chooses numbers of steps and compliances with which a run satisfies its tolerance."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mechsim.simulation.result import Run

# order of convergence of the default settings (measured in validation/choices/constraint_settings.py)
ORDER = 4.0
# target of attempts as a fraction of the tolerance, as a margin for errors that trials do not show
TARGET_FRACTION = 0.5
# minimum and maximum ratio of the steps of successive attempts; maximum number of steps per revolution, which
# a short motion may exceed if its predicted number of steps is larger
MIN_STEP_FACTOR, MAX_STEP_FACTOR, MAX_STEPS = 1.5, 4.0, 100_000
# steps per revolution up to which a finer run follows one that diverges
MAX_STEPS_AFTER_DIVERGENCE = 25_000
# ratio of successive errors below which more steps help
MIN_GAIN = 0.5


@dataclass
class NextSteps:
    """Chooses the steps of the next run from the last run; None if more steps do not help.

    Attributes:
        goal: target of the error estimate, in [m].
        trial_steps: steps per revolution of the finest trial. A run with fewer steps may not converge yet; a
            run with this number of steps follows it for any predicted error.
        max_steps: limit on the steps per revolution if the prediction lies between `MAX_STEPS` and it.
        remaining: error of the last run; None before the first.
    """

    goal: float
    trial_steps: int = 0
    max_steps: int = 0
    remaining: float | None = None

    def __call__(self, steps: int, run: Run) -> int | None:
        diverged = run.outcome == "diverged" and steps < MAX_STEPS_AFTER_DIVERGENCE
        gained = self.remaining is None or run.estimate < MIN_GAIN * self.remaining
        predicted = max(steps_for(steps, run.estimate, self.goal), MIN_STEP_FACTOR * steps)
        limit = self.max_steps if MAX_STEPS < predicted <= self.max_steps else MAX_STEPS
        final = run.outcome not in ("passed", "failed", "diverged")
        if final or not (gained or diverged) or steps >= limit:
            return None
        self.remaining = run.estimate
        most = self.trial_steps if steps < self.trial_steps else MAX_STEP_FACTOR * steps
        return rounded(min(predicted, most), limit)


def steps_for(steps: int, error: float, goal: float, order: float = ORDER) -> float:
    """Return the unrounded number of steps at which an error equals a goal."""
    return steps * ((error / goal) ** (1.0 / order) if np.isfinite(error) else MAX_STEP_FACTOR)


def rounded(steps: float, max_steps: int = MAX_STEPS) -> int:
    """Return the number of steps rounded up, at most the maximum."""
    return max(1, int(np.ceil(min(steps, max_steps) - 1e-9)))


# limits of the compliance: MuJoCo's minimum, and MuJoCo's default
MIN_COMPLIANCE, MAX_COMPLIANCE = 1e-16, 1.0
# smallest factor by which the compliance changes
MIN_FACTOR = 100.0


def improving_compliance(
    error: Callable[[float], float], compliance: float, initial_error: float, tolerance: float
) -> tuple[float, float] | None:
    """Return a compliance with a much smaller error, and that error; None without such a compliance.

    Args:
        error: compliance -> largest error of a run with it, in [m].
        compliance: the current compliance.
        initial_error: error with it, in [m].
        tolerance: the requested tolerance, in [m].
    """
    factor = max(MIN_FACTOR, initial_error / (TARGET_FRACTION * tolerance))
    tried = {compliance}
    for value in (compliance / factor, compliance * factor, compliance * MIN_FACTOR):
        candidate = min(max(value, MIN_COMPLIANCE), MAX_COMPLIANCE)
        if candidate in tried:
            continue
        tried.add(candidate)
        remaining = error(candidate)
        if remaining <= tolerance or remaining < MIN_GAIN * initial_error:
            return candidate, remaining
    return None
