"""Wrong, late and diverged motions fail with a reason in one line."""

from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.simulation import simulate

SPEED = 62.8
RSSR, FOUR_BAR = map(ms.catalog.make, ("rssr", "four_bar"))


def motion_of(linkage, speed=SPEED, samples=72, **options) -> ms.Motion:
    return simulate(linkage.mechanism, speed=speed, method="step", samples=samples, **options).motion


@pytest.fixture(scope="module")
def revolution():
    """A revolution of the four-bar."""
    return motion_of(FOUR_BAR)


def assert_rejected(verdict: ms.Verdict, outcome: str = "failed") -> None:
    assert verdict.outcome == outcome, verdict
    assert not verdict.passed
    assert verdict.reason
    assert "\n" not in verdict.reason


def test_a_nan_in_joints_or_residuals_is_detected(revolution) -> None:
    values, closure = revolution.joints["rocker"].value.copy(), revolution.closure.copy()
    values[3] = closure[-1] = np.nan
    joints = {**revolution.joints, "rocker": replace(revolution.joints["rocker"], value=values)}
    for changes in ({"joints": joints}, {"closure": closure}):
        assert_rejected(ms.crosscheck(replace(revolution, **changes), FOUR_BAR), "diverged")


@pytest.mark.parametrize("tolerance", [None, 1e9])
def test_a_run_that_diverges_late_fails_at_any_tolerance(tolerance) -> None:
    wild = ms.Settings(integrator="Euler", steps_per_turn=100, constant_steps=0.1)
    run = simulate(RSSR.mechanism, speed=SPEED, turns=5.0, settings=wild)
    assert_rejected(ms.crosscheck(run.motion, RSSR, tolerance=tolerance), "diverged")


def test_a_run_with_soft_loops_fails_with_its_error() -> None:
    verdict = ms.crosscheck(motion_of(RSSR, settings=ms.Settings(steps_per_turn=30)), RSSR, tolerance=1e-9)
    assert_rejected(verdict)
    assert "beyond the tolerance: position of P3 by" in verdict.reason


def test_a_closed_form_out_of_reach_is_reported(revolution) -> None:
    swinging = ms.catalog.make("four_bar", ground=0.1, crank=0.06, coupler=0.05, rocker=0.07)
    assert_rejected(ms.crosscheck(revolution, swinging), "cannot assemble")


def test_explicit_tolerances_replace_the_defaults(revolution) -> None:
    strict = {"acceleration": ms.Tolerance(1e-12, "m/s2", "as requested")}
    verdict = ms.crosscheck(revolution, FOUR_BAR, bounds=strict)
    assert_rejected(verdict)
    assert {check.title.split()[0] for check in verdict.checks if not check.passed} == {"acceleration"}
