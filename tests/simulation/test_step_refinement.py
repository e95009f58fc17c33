"""The choice of steps for a tolerance, on runs whose error is a formula."""

from types import SimpleNamespace

import numpy as np
import pytest

from mechsim.numerics.convergence import refine
from mechsim.simulation import position_tolerance
from mechsim.simulation.position_tolerance import TARGET_FRACTION, NextSteps


def refined(error, limit, first, **limits):
    """Return the refinement of runs with this error of their steps, and the list of requested steps."""
    requested = []

    def attempt(steps):
        requested.append(steps)
        return SimpleNamespace(steps=steps, estimate=error(steps), outcome="failed")

    following = NextSteps(TARGET_FRACTION * limit, **limits)
    return refine(attempt, first, following, limit).best, requested


def test_a_tolerance_is_satisfied_with_at_most_twice_the_needed_steps():
    run, _ = refined(lambda n: n**-4.0, 1e-6, 10)
    needed = 1e-6**-0.25
    assert run.estimate <= 1e-6
    assert needed <= run.steps <= 2.1 * needed


def test_the_best_run_is_returned_if_refinement_fails():
    run, requested = refined(lambda n: max(n**-4.0, 3e-8), 1e-9, 20)
    assert run.estimate == 3e-8
    assert len(requested) <= 4
    assert run.steps in requested


def test_two_attempts_without_an_estimate_end_the_refinement():
    run, requested = refined(lambda _: np.inf, 1e-9, 20)
    assert len(requested) == 2
    assert run.estimate == np.inf


def test_the_maximum_number_of_steps_is_respected(monkeypatch):
    monkeypatch.setattr(position_tolerance, "MAX_STEPS", 500)
    assert max(refined(lambda n: n**-1.0, 1e-9, 20)[1]) == 500


@pytest.mark.parametrize(("needed", "last"), [(1900, 1900), (2100, 500)])
def test_the_limit_is_exceeded_only_if_success_is_predicted(needed, last, monkeypatch):
    monkeypatch.setattr(position_tolerance, "MAX_STEPS", 500)
    limit = needed**-4.0 / TARGET_FRACTION
    run, requested = refined(lambda n: n**-4.0, limit, 490, max_steps=2000)
    assert requested[-1] == pytest.approx(last, rel=1e-3)
    assert (run.estimate <= limit) == (last > 500)


def test_an_attempt_coarser_than_the_trials_is_refined_to_them():
    assert refined(lambda n: 1.0 if n < 100 else 0.0, 1e-9, 30, trial_steps=100)[1] == [30, 100]
