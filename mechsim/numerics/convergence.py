"""Order of convergence, Pareto fronts, and refinement until an error estimate is within a tolerance."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import ClassVar, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim.errors import BudgetError
from mechsim.numerics.arrays import Array
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
        best: the attempt with the smallest estimate.
        level: level of the last attempt.
        ended: sentence on the exhausted budget; empty otherwise.
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
    """Return the best of several attempts, which end at a tolerance, at the last level, or with a budget.

    Args:
        attempt: level (such as a number of steps) -> result with its error estimate.
        level: level of the first attempt.
        following: level and result of an attempt -> level of the next one; None ends the refinement.
        tolerance: tolerance of the estimate.
        budget: budget of processor time. The time of an attempt is proportional to its level; an attempt that
            would exceed the budget is not started. None means no limit.

    Raises:
        BudgetError: if the budget ends during the first attempt.
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


# plausible range of an order of convergence from two runs: methods in use have order four at most
PLAUSIBLE_ORDERS = (1.0, 4.0)


def half_extent(paths: Iterable[Array]) -> float:
    """Return half the largest extent of any path (n, 3) along an axis: the stroke, in the paths' unit."""
    return 0.5 * float(max(np.ptp(path, axis=0).max() for path in paths))


@dataclass(frozen=True, slots=True)
class Order:
    """An observed order of convergence.

    Attributes:
        order: least-squares slope: the error is proportional to steps to the power of minus this.
        low: smallest slope between neighbours in the fit.
        high: largest such slope.
        count: number of points in the fit.
    """

    JSON: ClassVar[tuple[str, ...]] = ("order", "low", "high")

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
        errors: (n,); values that are not finite or not strictly between floor and ceiling are ignored.
        floor: error below which rounding or compliance dominates.
        ceiling: error above which the run has not started to converge.

    Returns:
        The order, or None with fewer than two different numbers of steps.
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


def plausible_order(coarse: float, fine: float, ratio: float) -> float:
    """Return the order of convergence of an error, clipped to a plausible range; the lowest if it is unknown.

    Args:
        coarse: the error.
        fine: the error with `ratio` times as many steps.
        ratio: above 1.
    """
    if not (0.0 < coarse < np.inf and 0.0 < fine < np.inf):
        return PLAUSIBLE_ORDERS[0]
    return float(np.clip(np.log(coarse / fine) / np.log(ratio), *PLAUSIBLE_ORDERS))


def pareto(costs: ArrayLike, errors: ArrayLike) -> NDArray[np.intp]:
    """Return the indices of the Pareto-optimal points in cost and error, by increasing cost.

    Args:
        costs: (n,); points with a cost or error that is not finite are ignored.
        errors: (n,).
    """
    cost, error = np.asarray(costs, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    # for equal costs the smaller error first, so that it dominates the others
    order = np.lexsort((error, cost))
    order = order[np.isfinite(cost[order]) & np.isfinite(error[order])]
    before = np.minimum.accumulate(np.concatenate([[np.inf], error[order]]))[:-1]
    return order[error[order] < before]


def cheapest(costs: ArrayLike, errors: ArrayLike, limit: float) -> int | None:
    """Return the index of the least cost among errors within a limit; None if there is none."""
    cost, error = np.asarray(costs, dtype=np.float64), np.asarray(errors, dtype=np.float64)
    fit = np.flatnonzero((error <= limit) & np.isfinite(cost))
    return int(fit[np.argmin(cost[fit])]) if len(fit) else None
