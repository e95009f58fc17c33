"""The number of steps for a tolerance is found by short trials and satisfies the tolerance."""

from collections.abc import Iterator
from types import SimpleNamespace
from unittest import mock

import numpy as np
import pytest
from model_files import FOLDER
from scene_texts import FINGER

import mechsim as ms
from mechsim.mechanism.motion_laws import swing
from mechsim.numerics.convergence import refine
from mechsim.simulation import driven_run, position_tolerance, simulate
from mechsim.simulation.position_tolerance import (
    MIN_STEPS,
    TARGET_FRACTION,
    TRIAL_STEPS,
    NextSteps,
    other_compliances,
)
from mechsim.simulation.settings import COMPLIANCE

TURNS = 10.0
SPEED = ms.units.rpm(100.0)


@pytest.fixture
def stepped() -> Iterator[list[int]]:
    """Return a list of the numbers of steps of all runs, including trials."""
    counts: list[int] = []
    step = driven_run.step

    def counting(*args, **options):
        steps = step(*args, **options)
        counts.append(steps.count)
        return steps

    with mock.patch.object(driven_run, "step", counting):
        yield counts


def error(linkage, motion) -> float:
    exact = linkage.positions(motion.angle)
    return max(
        float(np.linalg.norm(point.position - exact[name], axis=1).max())
        for name, point in motion.points.items()
    )


@pytest.mark.long
def test_growing_errors_per_turn_cost_only_a_coarse_run(stepped) -> None:
    # at this tolerance one turn of a Bennett linkage needs about 50 steps;
    # over ten turns such steps end in another assembly mode
    linkage = ms.catalog.make("bennett")
    tolerance = 2e-4 * linkage.length0
    run = simulate(linkage.mechanism, speed=SPEED, turns=TURNS, tolerance=tolerance)
    assert run.outcome == "passed"
    assert error(linkage, run.motion) <= tolerance
    assert len(stepped) == 3
    assert run.shortfall == ""
    assert sum(stepped) <= 1.6 * run.steps
    coarse = ms.Settings(steps_per_turn=round(stepped[1] / TURNS))
    short = simulate(linkage.mechanism, speed=SPEED, turns=1.0, settings=coarse)
    long = simulate(linkage.mechanism, speed=SPEED, turns=TURNS, settings=coarse)
    assert short.estimate <= tolerance
    assert long.estimate > 100.0 * tolerance


@pytest.mark.long
@pytest.mark.parametrize("name", ["four_bar", "rrsrr", "looper"])
@pytest.mark.parametrize("fraction", [1e-3, 3e-5])
def test_a_loose_tolerance_needs_only_one_full_run(name, fraction, stepped) -> None:
    linkage = ms.catalog.make(name)
    tolerance = fraction * linkage.crank
    run = simulate(linkage.mechanism, speed=SPEED, turns=TURNS, tolerance=tolerance)
    assert run.outcome == "passed"
    assert error(linkage, run.motion) <= tolerance
    assert sum(count > 5 * TRIAL_STEPS or count == run.steps for count in stepped) == 1
    assert run.steps < TURNS * TRIAL_STEPS


def test_a_zero_error_needs_the_minimum_number_of_steps() -> None:
    joint = ms.Joint("crank", "revolute", ms.End("ground"), ms.End("arm"))
    arm = ms.Mechanism("arm", (ms.Link("arm"),), (joint,), "crank", {"P": ("arm", (0.1, 0.0, 0.0))})
    run = simulate(arm, speed=SPEED, turns=TURNS, tolerance=1e-6)
    assert run.steps == TURNS * MIN_STEPS


@pytest.mark.parametrize("reach", [0.1, 0.01])
def test_a_swing_below_a_turn_satisfies_its_tolerance(reach) -> None:
    linkage = ms.catalog.make("four_bar")
    run = simulate(linkage.mechanism, profile=swing(1.0, reach, 60.0), tolerance=4e-10 * reach)
    assert run.outcome == "passed"
    assert error(linkage, run.motion) <= run.tolerance


def test_dense_samples_do_not_hide_the_effect_of_finer_steps() -> None:
    linkage = ms.catalog.make("rssr")
    run = simulate(linkage.mechanism, speed=SPEED, tolerance=1e-12, samples=1000)
    assert run.outcome == "passed"
    assert run.steps % 1000 == 0


def test_a_diverged_trial_is_repeated_with_finer_steps(file):
    path = file(FINGER.replace('damping="0.001"', 'damping="0.02"'))
    model = ms.load(path, drive={"knuckle": "0.3*sin(2*pi*t)"}, duration=0.2)
    coarse = simulate(model, settings=ms.Settings(steps_per_turn=100))
    assert coarse.outcome == "diverged"
    assert "stiffness" in coarse.motion.broken
    run = simulate(model, tolerance=1e-6)
    assert run.outcome == "passed"
    assert run.settings.steps_per_turn >= 1000


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


# a slow five-bar under gravity: the loop-closure error is proportional to the square of the period
FIVE_BAR = str(FOLDER / "compliance_search_five_bar.xml")
DRIVES = {"left": "0.11*sin(2*pi*t/100)", "right": "0.13*sin(2*pi*t/100)"}
TOLERANCE = 2e-11


@pytest.mark.parametrize(
    ("error", "bounds"),
    [
        (lambda h: 0.3 * h, (1e-12, 1e-10)),
        (lambda h: 1e-17 / h, (1e-6, 1e-4)),
        # the second term as soon as it dominates the first
        (lambda h: 1e-7 * h + 1e-17 / h, (1e-6, 1e-4)),
    ],
)
def test_the_compliance_search_follows_the_decreasing_error(error, bounds):
    compliance = next(other for other in other_compliances(1e-8, error(1e-8), 1e-11) if error(other) <= 1e-11)
    assert bounds[0] <= compliance <= bounds[1]


def test_a_slow_motion_under_gravity_gets_stiffer_loops():
    run = simulate(ms.load(FIVE_BAR, drive=DRIVES, duration=100.0), tolerance=TOLERANCE)
    assert run.outcome == "passed"
    assert run.estimate <= TOLERANCE
    assert run.settings.compliance < 0.1 * COMPLIANCE
    assert f"compliance {run.settings.compliance:.2g}: 1e-08 leaves a position error of" in run.note


@pytest.mark.long
def test_a_failed_run_with_a_requested_compliance_suggests_a_better_one():
    model = ms.load(FIVE_BAR, drive=DRIVES, duration=100.0)
    failed = simulate(model, tolerance=TOLERANCE, settings=ms.Settings(compliance=1e-8))
    assert (failed.outcome, failed.settings.compliance) == ("failed", 1e-8)
    better = float(failed.note.partition("and by compliance ")[2].split()[0])
    run = simulate(model, tolerance=TOLERANCE, settings=ms.Settings(compliance=better))
    assert run.outcome == "passed", run
