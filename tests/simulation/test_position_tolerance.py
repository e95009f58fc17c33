"""The number of steps for a tolerance is found by short trials and satisfies the tolerance."""

from collections.abc import Iterator
from unittest import mock

import numpy as np
import pytest
from scene_texts import FINGER

import mechsim as ms
from mechsim.mechanism.motion_laws import swing
from mechsim.simulation import driven_run, simulate
from mechsim.simulation.position_tolerance import MIN_STEPS, TRIAL_STEPS

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
def test_growing_errors_per_turn_cost_only_a_short_trial(stepped) -> None:
    # at this tolerance one turn of a Bennett linkage needs about 50 steps;
    # over ten turns such steps end in another assembly mode
    linkage = ms.catalog.make("bennett")
    tolerance = 2e-4 * linkage.length0
    run = simulate(linkage.mechanism, speed=SPEED, turns=TURNS, tolerance=tolerance)
    assert run.outcome == "passed"
    assert error(linkage, run.motion) <= tolerance
    assert len(stepped) == 3
    assert run.shortfall == ""
    assert sum(stepped) <= 1.25 * run.steps
    coarse = ms.Settings(steps_per_turn=stepped[1] // 2)
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
