"""Refines a run with more and more steps until its error estimate satisfies a tolerance."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from mechsim.numerics.convergence import refine
from mechsim.numerics.resources import ProcessorBudget

R = TypeVar("R")

# target of attempts as a fraction of the tolerance, as a margin for errors that trials do not show
TARGET_FRACTION = 0.5
# minimum and maximum ratio of the steps of successive attempts; maximum number of steps per revolution, which
# a short motion may exceed if its predicted number of steps is larger
MIN_STEP_FACTOR, MAX_STEP_FACTOR, MAX_STEPS = 1.5, 4.0, 100_000
# steps per revolution up to which a finer run follows one that diverges
MAX_STEPS_AFTER_DIVERGENCE = 25_000
# ratio of successive errors below which more steps help
MIN_GAIN = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class ToleranceReport:
    """Whether a run satisfies its tolerance, with the error estimate.

    Attributes:
        tolerance: requested tolerance, in the unit of the estimate.
        estimate: largest error at any recorded instant.
        trials: steps of all other runs.
        reason: sentence on a tolerance that is not satisfied; empty otherwise.
    """

    tolerance: float
    estimate: float
    trials: int = 0
    reason: str = ""

    @property
    def satisfied(self) -> bool:
        """Whether the estimate is within the tolerance."""
        return self.estimate <= self.tolerance


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt(Generic[R]):
    """A run with a number of steps, and its error estimate.

    Attributes:
        run: the run.
        steps: number of steps of the run.
        estimate: as in `ToleranceReport`.
        order: order of convergence in the number of steps.
        final: whether more steps cannot help.
        diverged: whether the run diverged, so that its convergence is unknown.
    """

    run: R
    steps: int
    estimate: float
    order: float
    final: bool = False
    diverged: bool = False


@dataclass
class _NextSteps:
    """Chooses the steps of the next attempt from the last; None if more steps do not help.

    Attributes:
        goal: target of the error estimate.
        trial_steps, max_steps: as in `run_within_tolerance`.
        remaining: error of the last attempt; None before the first.
    """

    goal: float
    trial_steps: int
    max_steps: int
    remaining: float | None = None

    def __call__(self, steps: int, current: Attempt[Any]) -> int | None:
        diverged = current.diverged and steps < MAX_STEPS_AFTER_DIVERGENCE
        gained = self.remaining is None or current.estimate < MIN_GAIN * self.remaining
        predicted = max(steps_for(steps, current.estimate, self.goal, current.order), MIN_STEP_FACTOR * steps)
        limit = self.max_steps if MAX_STEPS < predicted <= self.max_steps else MAX_STEPS
        if current.final or not (gained or diverged) or steps >= limit:
            return None
        self.remaining = current.estimate
        most = self.trial_steps if steps < self.trial_steps else MAX_STEP_FACTOR * steps
        return rounded(min(predicted, most), limit)


def run_within_tolerance(
    attempt: Callable[[int], Attempt[R]],
    tolerance: float,
    first: int,
    reason_text: Callable[[int, float], str],
    *,
    trials: int = 0,
    trial_steps: int = 0,
    max_steps: int = 0,
    budget: ProcessorBudget | None = None,
) -> tuple[R, ToleranceReport]:
    """Return a run that satisfies a tolerance, or the best run, and its tolerance report.

    Args:
        attempt: steps per revolution -> a run.
        tolerance: tolerance on the estimate.
        first: steps per revolution of the first attempt.
        reason_text: steps of the last attempt and its estimate -> reason why the tolerance is not satisfied.
        trials: steps taken so far.
        trial_steps: steps per revolution of the finest trial. An attempt with fewer steps may not converge
            yet; an attempt with this number of steps follows it for any predicted error.
        max_steps: limit on the steps per revolution if the prediction lies between `MAX_STEPS` and it.
        budget: budget of processor time; an attempt that would exceed it does not start. None means no limit.

    Raises:
        BudgetError: if the budget ends before the first attempt.
    """
    spent = trials

    def counted(steps: int) -> Attempt[R]:
        nonlocal spent
        current = attempt(steps)
        spent += current.steps
        return current

    following = _NextSteps(TARGET_FRACTION * tolerance, trial_steps, max_steps)
    result = refine(counted, first, following, tolerance, budget)
    best = result.best
    reason = "" if best.estimate <= tolerance else reason_text(result.level, best.estimate)
    if reason and result.ended:
        reason = f"{result.ended}; {reason}"
    trials = spent - best.steps
    return best.run, ToleranceReport(
        tolerance=tolerance, estimate=best.estimate, trials=trials, reason=reason
    )


def steps_for(steps: int, error: float, goal: float, order: float) -> float:
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
