"""The one loop that keeps a tolerance, on runs whose error is a formula."""

import numpy as np
import pytest

from mechsim.simulation import tolerance
from mechsim.simulation.tolerance import Attempt


def attempts(error, *, order=4.0, final=lambda _: False, trials=0):
    """Return what runs with an error of so many steps, and the numbers of steps it was asked for."""
    asked = []

    def attempt(steps):
        asked.append(steps)
        estimates = {"place": error(steps)}
        return Attempt(
            run=steps, steps=steps, estimates=estimates, order=order, trials=trials, final=final(steps)
        )

    return attempt, asked


def why(steps, estimate):
    return f"{steps} steps leave {estimate:.2g}"


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_a_tolerance_is_kept_by_few_more_steps_than_it_needs(order):
    attempt, asked = attempts(lambda n: n**-order, order=order)
    run, promise = tolerance.run_within_tolerance(attempt, 1e-6 ** (order / 4.0), 10, why)
    needed = 1e-6**-0.25
    assert promise.satisfied
    assert promise.reason == ""
    assert needed <= run <= 2.1 * needed
    assert promise.trials == sum(asked) - run
    assert promise.safety_factor >= 1.0


def test_a_first_attempt_that_is_good_is_the_only_one():
    attempt, asked = attempts(lambda _: 0.0, trials=7)
    run, promise = tolerance.run_within_tolerance(attempt, 1e-9, 50, why, trials=3)
    assert (run, asked, promise.trials) == (50, [50], 10)
    assert promise.safety_factor == np.inf


def test_where_more_steps_do_not_help_the_best_is_given_with_the_reason():
    attempt, asked = attempts(lambda n: max(n**-4.0, 3e-8))
    run, promise = tolerance.run_within_tolerance(attempt, 1e-9, 20, why)
    assert not promise.satisfied
    assert promise.estimate == 3e-8
    assert promise.reason == f"{asked[-1]} steps leave 3e-08"
    assert len(asked) <= 4
    assert run in asked


def test_a_run_that_no_steps_would_help_is_the_last():
    attempt, asked = attempts(lambda _: np.inf, final=lambda _: True)
    _, promise = tolerance.run_within_tolerance(attempt, 1e-9, 20, why)
    assert asked == [20]
    assert promise.reason


def test_two_runs_without_an_error_to_speak_of_are_enough():
    attempt, asked = attempts(lambda _: np.nan)
    _, promise = tolerance.run_within_tolerance(attempt, 1e-9, 20, why)
    assert len(asked) == 2
    assert promise.estimate == np.inf
    assert not promise.satisfied


def test_no_more_steps_than_the_most_are_spent(monkeypatch):
    monkeypatch.setattr(tolerance, "MAX_STEPS", 500)
    attempt, asked = attempts(lambda n: n**-1.0, order=1.0)
    _, promise = tolerance.run_within_tolerance(attempt, 1e-9, 20, why, multiple=2)
    assert max(asked) == 500
    assert not promise.satisfied


@pytest.mark.parametrize(("needed", "last"), [(1900, 1900), (2100, 500)])
def test_more_than_the_most_are_spent_only_where_they_are_predicted_to_be_enough(needed, last, monkeypatch):
    monkeypatch.setattr(tolerance, "MAX_STEPS", 500)
    attempt, asked = attempts(lambda n: n**-4.0)
    _, promise = tolerance.run_within_tolerance(
        attempt, needed**-4.0 / tolerance.TARGET_FRACTION, 490, why, max_steps=2000
    )
    assert asked[-1] == pytest.approx(last, rel=1e-3)
    assert promise.satisfied == (last > 500)


def test_an_attempt_coarser_than_the_trials_is_followed_by_one_as_fine():
    attempt, asked = attempts(lambda n: 1.0 if n < 100 else 0.0)
    tolerance.run_within_tolerance(attempt, 1e-9, 30, why, trial_steps=100)
    assert asked == [30, 100]


def test_numbers_of_steps_are_multiples_of_what_is_requested_for():
    attempt, asked = attempts(lambda n: n**-4.0)
    tolerance.run_within_tolerance(attempt, 1e-12, 48, why, multiple=48)
    assert all(n % 48 == 0 for n in asked)


def test_the_worst_of_all_estimates_counts_and_what_is_no_number_is_the_worst():
    promise = tolerance.ToleranceReport(tolerance=1.0, estimates={"torque": 0.5, "halving": 2.0})
    assert promise.estimate == 2.0
    assert not promise.satisfied
    assert not tolerance.ToleranceReport(tolerance=1.0, estimates={"torque": np.nan}).satisfied
    assert tolerance.ToleranceReport(tolerance=1.0, estimates={"torque": 1.0}).satisfied
