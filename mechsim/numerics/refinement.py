"""Refinement: attempts at finer and finer levels until an error estimate is within a tolerance."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from mechsim.errors import BudgetError
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
