"""The refinement loop for a tolerance, on runs whose error is a formula."""

import numpy as np
import pytest

from mechsim.simulation import tolerance
from mechsim.simulation.tolerance import Attempt


def attempts(error, *, order=4.0, final=lambda _: False):
    """Return an attempt function with this error of its steps, and the list of requested steps."""
    requested = []

    def attempt(steps):
        requested.append(steps)
        return Attempt(run=steps, steps=steps, estimate=error(steps), order=order, final=final(steps))

    return attempt, requested


def reason_for(steps, estimate):
    return f"{steps} steps leave {estimate:.2g}"


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_a_tolerance_is_satisfied_with_at_most_twice_the_needed_steps(order):
    attempt, requested = attempts(lambda n: n**-order, order=order)
    run, report = tolerance.run_within_tolerance(attempt, 1e-6 ** (order / 4.0), 10, reason_for)
    needed = 1e-6**-0.25
    assert report.satisfied
    assert report.reason == ""
    assert needed <= run <= 2.1 * needed
    assert report.trials == sum(requested) - run


def test_the_best_run_is_returned_with_a_reason_if_refinement_fails():
    attempt, requested = attempts(lambda n: max(n**-4.0, 3e-8))
    run, report = tolerance.run_within_tolerance(attempt, 1e-9, 20, reason_for)
    assert not report.satisfied
    assert report.estimate == 3e-8
    assert report.reason == f"{requested[-1]} steps leave 3e-08"
    assert len(requested) <= 4
    assert run in requested


def test_two_attempts_without_an_estimate_end_the_refinement():
    attempt, requested = attempts(lambda _: np.inf)
    _, report = tolerance.run_within_tolerance(attempt, 1e-9, 20, reason_for)
    assert len(requested) == 2
    assert report.estimate == np.inf
    assert not report.satisfied


def test_the_maximum_number_of_steps_is_respected(monkeypatch):
    monkeypatch.setattr(tolerance, "MAX_STEPS", 500)
    attempt, requested = attempts(lambda n: n**-1.0, order=1.0)
    _, report = tolerance.run_within_tolerance(attempt, 1e-9, 20, reason_for)
    assert max(requested) == 500
    assert not report.satisfied


@pytest.mark.parametrize(("needed", "last"), [(1900, 1900), (2100, 500)])
def test_the_limit_is_exceeded_only_if_success_is_predicted(needed, last, monkeypatch):
    monkeypatch.setattr(tolerance, "MAX_STEPS", 500)
    attempt, requested = attempts(lambda n: n**-4.0)
    _, report = tolerance.run_within_tolerance(
        attempt, needed**-4.0 / tolerance.TARGET_FRACTION, 490, reason_for, max_steps=2000
    )
    assert requested[-1] == pytest.approx(last, rel=1e-3)
    assert report.satisfied == (last > 500)


def test_an_attempt_coarser_than_the_trials_is_refined_to_them():
    attempt, requested = attempts(lambda n: 1.0 if n < 100 else 0.0)
    tolerance.run_within_tolerance(attempt, 1e-9, 30, reason_for, trial_steps=100)
    assert requested == [30, 100]


def test_an_estimate_of_nan_fails():
    assert not tolerance.ToleranceReport(tolerance=1.0, estimate=np.nan).satisfied
    assert tolerance.ToleranceReport(tolerance=1.0, estimate=1.0).satisfied
