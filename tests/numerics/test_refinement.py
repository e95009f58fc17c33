"""Refinement ends at the tolerance, at the last level or with the budget, and returns the best attempt."""

from dataclasses import dataclass

import pytest

from mechsim.errors import BudgetError
from mechsim.numerics.convergence import refine
from mechsim.numerics.resources import ProcessorBudget


@dataclass(frozen=True)
class Attempt:
    level: int
    estimate: float


def fourth_order(level):
    return Attempt(level, level**-4.0)


def doubled(level, _):
    return 2 * level if level < 64 else None


def test_the_first_attempt_within_the_tolerance_is_the_last():
    result = refine(fourth_order, 2, doubled, 1e-5)
    assert result.level == result.best.level == 32  # 16**-4 is 1.5e-5, 32**-4 is 9.5e-7
    assert not result.ended


def test_without_further_levels_the_least_estimate_is_returned():
    rounding = {2: 1e-2, 4: 1e-5, 8: 3e-5, 16: float("nan"), 32: float("inf"), 64: 2e-5}
    result = refine(lambda level: Attempt(level, rounding[level]), 2, doubled, 0.0)
    assert (result.best.level, result.level) == (4, 64)


def test_an_attempt_that_would_exceed_the_budget_is_not_started():
    seconds = [0.0]

    def attempt(level):
        seconds[0] += level
        return fourth_order(level)

    budget = ProcessorBudget(20.0, now=lambda: seconds[0])
    result = refine(attempt, 2, doubled, 0.0, budget)
    # 2 + 4 + 8 are spent, and 16 more would be 30
    assert result.best.level == result.level == 8
    assert "20 s" in result.ended


def test_an_exhausted_budget_returns_the_best_attempt():
    def attempt(level):
        if level > 4:
            raise BudgetError("ended within it")
        return fourth_order(level)

    result = refine(attempt, 2, doubled, 0.0)
    assert (result.best.level, result.ended) == (4, "ended within it")
    with pytest.raises(BudgetError):
        refine(attempt, 8, doubled, 0.0)
