"""Order of convergence, Pareto fronts, and refinement until an error estimate is within a tolerance."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import BudgetError
from mechsim.numerics.arrays import Array, worst
from mechsim.numerics.resources import ProcessorBudget


class Estimated(Protocol):
    """A result with an estimate of its error."""

    @property
    def estimate(self) -> float: ...


A = TypeVar("A", bound=Estimated)


@dataclass(frozen=True, slots=True)
class Refinement(Generic[A]):
    """The result of a refinement.

    Attributes:
        best: the attempt with the least estimate.
        level: of the last attempt.
        ended: sentence on how the budget ended it; empty otherwise.
    """

    best: A
    level: int
    ended: str = ""


def refine(
    attempt: Callable[[int], A],
    level: int,
    following: Callable[[int, A], int | None],
    tolerance: float,
    budget: ProcessorBudget | None = None,
) -> Refinement[A]:
    """Return the best of attempts that end at a tolerance, at the last level, or with a budget.

    Args:
        attempt: level, as a number of steps, -> a result with its estimate.
        level: of the first attempt.
        following: level and result of an attempt -> level of the next one; None ends the refinement.
        tolerance: of the estimate.
        budget: of processor time, of which attempts take in proportion to their levels; one that would exceed
            it is not started. None is no limit.

    Raises:
        BudgetError: where the budget ends during the first attempt.
    """
    best: A | None = None
    while True:
        start = 0.0 if budget is None else budget.spent
        try:
            current = attempt(level)
        except BudgetError as error:
            if best is None:
                raise
            return Refinement(best, level, str(error))
        if best is None or current.estimate < best.estimate:
            best = current
        next_level = None if current.estimate <= tolerance else following(level, current)
        if next_level is None:
            return Refinement(best, level)
        if budget is not None and not budget.affords((budget.spent - start) * next_level / level):
            return Refinement(best, level, budget.ended)
        level = next_level


# orders of convergence that two runs may show: beyond the highest, of the methods used, it is chance
BELIEVED = (1.0, 4.0)


def half_extent(paths: Iterable[Array]) -> float:
    """Return half the largest extent of any path (n, 3) along an axis: the stroke, in the paths' unit."""
    return 0.5 * float(max(np.ptp(path, axis=0).max() for path in paths))


@dataclass(frozen=True, slots=True)
class Order:
    """An observed order of convergence.

    Attributes:
        order: the slope of least squares: error falls as steps to the power of minus this.
        low: least slope between neighbours that were used.
        high: largest such slope.
        count: points used.
    """

    order: float
    low: float
    high: float
    count: int


def observed_order(
    steps: ArrayLike, errors: ArrayLike, *, floor: float = 0.0, ceiling: float = np.inf
) -> Order | None:
    """Return the order at which errors fall with the number of steps, fitted on log-log axes.

    Args:
        steps: numbers of steps (or inverse step sizes), (n,), above 0.
        errors: (n,); what is not finite or not strictly between floor and ceiling is left out.
        floor: error below which rounding or compliance dominates.
        ceiling: error above which the run has not started to converge.

    Returns:
        The order, or None where fewer than two different numbers of steps are left.
    """
    n, error = np.asarray(steps, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    fit = np.isfinite(error) & (error > floor) & (error < ceiling) & (n > 0.0)
    rising = np.argsort(n[fit], kind="stable")
    x, y = np.log(n[fit][rising]), np.log(error[fit][rising])
    if len(np.unique(x)) < 2:
        return None
    deviation = x - x.mean()
    exponent = float(deviation @ y / (deviation @ deviation))
    apart = np.diff(x) > 0.0
    local = -np.diff(y)[apart] / np.diff(x)[apart]
    return Order(-exponent, float(local.min()), float(local.max()), len(x))


def believed_order(coarse: float, fine: float, ratio: float) -> float:
    """Return the order at which an error fell, as far as it is believed; the lowest where that is not known.

    Args:
        coarse: the error.
        fine: the same with `ratio` times as many steps.
        ratio: above 1.
    """
    if not (0.0 < coarse < np.inf and 0.0 < fine < np.inf):
        return BELIEVED[0]
    return float(np.clip(np.log(coarse / fine) / np.log(ratio), *BELIEVED))


def pareto(costs: ArrayLike, errors: ArrayLike) -> NDArray[np.intp]:
    """Return the points nothing beats in both cost and error, by rising cost.

    Args:
        costs: (n,); points whose cost or error is not finite are never among them.
        errors: (n,).
    """
    cost, error = np.asarray(costs, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    # of equal costs the smaller error first, so that it shadows the others
    order = np.lexsort((error, cost))
    order = order[np.isfinite(cost[order]) & np.isfinite(error[order])]
    before = np.minimum.accumulate(np.concatenate([[np.inf], error[order]]))[:-1]
    return order[error[order] < before]


def cheapest(costs: ArrayLike, errors: ArrayLike, limit: float) -> int | None:
    """Return which point has the least cost among those with an error within a limit; None if none has."""
    cost, error = np.asarray(costs, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    fit = np.flatnonzero((error <= limit) & np.isfinite(cost))
    return int(fit[np.argmin(cost[fit])]) if len(fit) else None


def richardson(coarse: Array, fine: Array, ratio: float, order: float) -> tuple[Array, float]:
    """Return the value that two runs point to, and the error of the finer one.

    Args:
        coarse: values of the run with fewer steps.
        fine: the same of the run with `ratio` times as many.
        ratio: above 1.
        order: at which the error falls.

    Returns:
        The extrapolated values, and the largest distance of the finer run from them.
    """
    change = (fine - coarse) / (ratio**order - 1.0)
    return fine + change, worst(change)
