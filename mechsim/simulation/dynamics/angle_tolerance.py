"""The time step for a wanted accuracy of a free run, and the proof that it keeps it.

Nothing but the run itself is asked: with steps twice as long the crank comes elsewhere. Where the error
falls nearly by the fourth order, a tenth of that way is more than the shorter steps still err by; else the
whole of it counts.
"""

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from mechsim.maths.norms import worst
from mechsim.simulation.dynamics.free_steps import FreeSteps
from mechsim.simulation.model_loops import ModelLoops
from mechsim.simulation.settings import Settings

Array = NDArray[np.float64]

# steps a turn of the coarsest of three trials, each with twice those before; and the most that are spent
COARSEST, MOST = 60, 100_000
# orders by which steps are chosen
ORDERS = (1.0, 4.0)
# an error that falls by this order or more is taken to fall by this order; else all that the last halving
# changed counts
SURE = 3.4
# times as many steps as before, at the most
FURTHEST = 4.0
# part of the tolerance aimed at
AIM = 0.5


@dataclass(frozen=True, slots=True)
class Gone:
    """A run stepped once: its records, model, settings, time spent, and how many records go to a sample."""

    march: FreeSteps
    loops: ModelLoops
    settings: Settings
    seconds: float
    every: int


class Go(Protocol):
    """Steps the machine with so many steps a turn, and records as with a `per_record`-th part of them."""

    def __call__(self, steps: int, per_record: int = 1) -> Gone: ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Promise:
    """What was asked of a free run and how it came out.

    Attributes:
        tolerance: on the crank angle at every instant, in [rad].
        estimate: worst error of the crank angle, in [rad], by halving the steps.
        order: at which it was seen to fall.
        trials: steps taken on all other runs.
        reason: one sentence where the tolerance is not kept.
    """

    tolerance: float
    estimate: float
    order: float
    trials: int
    reason: str = ""

    @property
    def met(self) -> bool:
        """Whether the estimate is within the tolerance; NaN is not."""
        return self.estimate <= self.tolerance

    @property
    def margin(self) -> float:
        """The tolerance over the estimate."""
        return self.tolerance / self.estimate if self.estimate > 0.0 else np.inf


def promised(go: Go, tolerance: float, least: float) -> tuple[Gone, Promise]:
    """Return a run whose crank angle keeps a tolerance in [rad], or the best there is; and its promise.

    Args:
        go: steps the machine.
        tolerance: in [rad].
        least: steps a turn of the coarsest trial, so that stepping is stable.
    """
    steps = _even(max(COARSEST, least))
    first, second, run = (go(steps << i, 1 << i) for i in range(3))
    spent = first.march.steps + second.march.steps
    before, last = _apart(first, second), _apart(second, run)
    order, estimate = _judged(before, last, 2.0)
    steps *= 4
    best = run, Promise(tolerance=tolerance, estimate=estimate, order=order, trials=spent)
    while not best[1].met and steps < MOST:
        more = (estimate / (AIM * tolerance)) ** (1.0 / order) if estimate < np.inf else FURTHEST
        finer = _even(min(MOST, steps * np.clip(more, 1.5, FURTHEST)))
        spent += run.march.steps
        half, run = go(finer // 2), go(finer, 2)
        spent += half.march.steps
        before, last = last, _apart(half, run)
        order, estimate = _judged(before, last, finer / steps)
        steps, gained = finer, last < 0.5 * before
        if estimate < best[1].estimate or best[1].estimate == np.inf:
            best = run, Promise(tolerance=tolerance, estimate=estimate, order=order, trials=spent)
        if not gained and last < np.inf:
            break
    run, promise = best
    if promise.met:
        return run, promise
    end = f"{MOST} steps a turn, the most that are spent," if steps >= MOST else f"{steps} steps a turn"
    why = f"{end} leave the crank angle off by {promise.estimate:.2g} rad; run fewer turns or allow more"
    return run, replace(promise, reason=why)


def _judged(before: float, last: float, ratio: float) -> tuple[float, float]:
    """Return the order at which halving changed less and less, and the error that is left.

    Args:
        before: what halving changed.
        last: the same with `ratio` times as many steps.
        ratio: above 1.
    """
    order = ORDERS[0]
    if last > 0.0 and before < np.inf:
        order = float(np.clip(np.log(before / last) / np.log(ratio), *ORDERS))
    return order, last / (2.0**SURE - 1.0) if order >= SURE else last


def _apart(coarse: Gone, fine: Gone) -> float:
    """Return how far two runs' crank angles are apart at the instants they share, in [rad]."""
    if "diverged" in (coarse.march.outcome, fine.march.outcome):
        return np.inf
    place, n = fine.loops.crank_place, min(len(coarse.march.time), len(fine.march.time))
    return worst(fine.march.qpos[:n, place] - coarse.march.qpos[:n, place])


def _even(steps: float) -> int:
    return 2 * int(np.ceil(0.5 * steps - 1e-9))
