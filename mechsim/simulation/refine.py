"""Keeping a tolerance: a run with more and more steps until its own estimate says it is kept, or why not."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np

from mechsim.errors import BudgetError
from mechsim.numerics.arrays import worst
from mechsim.numerics.resources import ProcessorBudget

R = TypeVar("R")

# part of the tolerance aimed at, for what trials do not see
TARGET_FRACTION = 0.5
# times as many steps as before, at least and at most; and the most in a turn that are spent, but for a short
# motion that more of them are foretold to settle
LEAST, FURTHEST, MOST = 1.5, 4.0, 100_000
# steps in a turn up to which a run that diverges is followed by a finer one
MAX_STEPS_AFTER_DIVERGENCE = 25_000
# more steps help where what is left of the error is less than this part of what was
MIN_GAIN = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class ToleranceReport:
    """What was asked of a run and how it came out.

    Attributes:
        tolerance: asked for, in whatever the estimates are.
        estimates: of the worst error at any recorded instant, by how it was found.
        order: at which the error was seen to fall with the number of steps; None where nothing was stepped.
        trials: steps taken on all other runs.
        reason: one sentence where the tolerance is not kept.
    """

    tolerance: float
    estimates: Mapping[str, float]
    order: float | None = None
    trials: int = 0
    reason: str = ""

    @property
    def estimate(self) -> float:
        """The worst of all estimates; infinity where one is not a number."""
        return worst(list(self.estimates.values()))

    @property
    def satisfied(self) -> bool:
        """Whether the estimate is within the tolerance."""
        return self.estimate <= self.tolerance

    @property
    def margin(self) -> float:
        """The tolerance over the estimate."""
        return self.tolerance / self.estimate if self.estimate > 0.0 else np.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt(Generic[R]):
    """A run with some number of steps, and what is known of its error.

    Attributes:
        run: the run.
        steps: it took.
        estimates: as in `Promise`.
        order: at which the error falls with the number of steps.
        trials: steps taken on other runs for the sake of the estimates.
        change: what the estimate is made of, where that tells better whether the error falls.
        final: whether no number of steps would help.
        lost: whether the run diverged, so that it tells nothing of what more steps do.
    """

    run: R
    steps: int
    estimates: Mapping[str, float]
    order: float
    trials: int = 0
    change: float = field(default=np.nan)
    final: bool = False
    diverged: bool = False

    @property
    def estimate(self) -> float:
        """The worst of all estimates."""
        return worst(list(self.estimates.values()))

    @property
    def remaining(self) -> float:
        """What is to fall from one attempt to the next."""
        return self.estimate if np.isnan(self.change) else self.change


def refine(
    attempt: Callable[[int], Attempt[R]],
    tolerance: float,
    first: int,
    why: Callable[[int, float], str],
    *,
    trials: int = 0,
    tried: int = 0,
    multiple: int = 1,
    most: int = 0,
    budget: ProcessorBudget | None = None,
) -> tuple[R, ToleranceReport]:
    """Return a run that keeps a tolerance, or the best there is, and its promise.

    Args:
        attempt: steps in a turn -> a run with so many.
        tolerance: bound on the estimates.
        first: steps in a turn of the first attempt.
        why: steps of the last attempt and estimate that is left -> why the tolerance is not kept.
        trials: steps taken so far.
        tried: steps in a turn of the finest trial: an attempt with fewer has not begun to converge, and is
            followed by one with as many, whatever its estimate foretells.
        multiple: of which numbers of steps are taken.
        most: steps in a turn that are spent where fewer than these, and more than `MOST`, are foretold to do.
        budget: of processor time; an attempt that would exceed it is not begun. None is no limit.

    Raises:
        BudgetError: where the budget ends before the first attempt does.
    """
    steps, spent, left, best, ended = first, trials, np.inf, None, ""
    while True:
        begun = 0.0 if budget is None else budget.spent
        try:
            now = attempt(steps)
        except BudgetError as error:
            if best is None:
                raise
            ended = str(error)
            break
        spent += now.trials + now.steps
        lost = now.diverged and steps < MAX_STEPS_AFTER_DIVERGENCE
        gained = best is None or now.remaining < MIN_GAIN * left or lost
        if best is None or now.estimate < best.estimate:
            best = now
        more = max(steps_for(steps, now.estimate, TARGET_FRACTION * tolerance, now.order), LEAST * steps)
        enough = most if MOST < more <= most else MOST
        if now.estimate <= tolerance or now.final or not gained or steps >= enough:
            break
        left, before = now.remaining, steps
        steps = rounded(min(more, tried if steps < tried else FURTHEST * steps), multiple, enough)
        if budget is not None and not budget.affords((budget.spent - begun) * steps / before):
            ended = budget.ended
            steps = before
            break
    reason = "" if best.estimate <= tolerance else why(steps, best.estimate)
    if reason and ended:
        reason = f"{ended}; {reason}"
    promise = ToleranceReport(
        tolerance=tolerance,
        estimates=best.estimates,
        order=best.order,
        trials=spent - best.steps,
        reason=reason,
    )
    return best.run, promise


def steps_for(steps: int, error: float, goal: float, order: float) -> float:
    """Return with how many steps an error falls, or may rise, to a goal; it need not be a whole number."""
    return steps * ((error / goal) ** (1.0 / order) if np.isfinite(error) else FURTHEST)


def rounded(steps: float, multiple: int = 1, most: int = MOST) -> int:
    """Return the next multiple of a number, one at least, and no more than the most steps that are spent."""
    return multiple * max(1, int(np.ceil(min(steps, most) / multiple - 1e-9)))
