"""Refinement of stepped runs ends with its budget of processor time and reports the error reached."""

import pytest

import mechsim as ms
from mechsim.errors import BudgetError
from mechsim.numerics.resources import ProcessorBudget
from mechsim.studies import validate
from mechsim.studies.validate import case_of


class Timer:
    """Processor time set by the tests; each reading of it takes a fixed time."""

    def __init__(self, reading_time: float = 0.0):
        self.now, self.look = 0.0, reading_time

    def __call__(self) -> float:
        self.now += self.look
        return self.now


def test_a_budget_shorter_than_the_first_run_is_reported() -> None:
    budget = ProcessorBudget(1.0, now=Timer(reading_time=0.6))
    with pytest.raises(BudgetError, match=r"not converged within the budget of 1 s .* it reached 8,192 of"):
        ms.simulate(ms.load("four_bar").mechanism, speed=60.0, turns=100, method="step", budget=budget)


def test_a_validation_reports_an_exhausted_budget(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(validate, "STEPS", 60)
    case = case_of(ms.load("four_bar"), budget=1e-9, tolerance=1e-14)
    assert not case.passed
    assert "step: not converged within the budget of 1e-09 s of processor time" in case.verdict.reason
