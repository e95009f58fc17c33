"""The number of steps for a tolerance: kept, and found without a whole run being lost."""

from collections.abc import Iterator
from unittest import mock

import numpy as np
import pytest
from scene_texts import FINGER

from mechsim import catalog, units
from mechsim.model.motion_laws import swing, within_range
from mechsim.simulation import Settings, driven_run, position_tolerance, simulate
from mechsim.simulation.position_tolerance import TRIAL_STEPS
from mechsim.subjects.readers import load

TURNS = 10.0
SPEED = units.rpm(100.0)


@pytest.fixture
def stepped() -> Iterator[list[int]]:
    """Give a list that takes the number of steps of every run stepped, trials too."""
    counts: list[int] = []
    step = driven_run.step

    def counting(*given, **options):
        steps = step(*given, **options)
        counts.append(steps.count)
        return steps

    with mock.patch.object(driven_run, "step", counting):
        yield counts


def error(drive, motion) -> float:
    exact = drive.positions(motion.angle)
    return max(
        float(np.linalg.norm(point.position - exact[name], axis=1).max())
        for name, point in motion.points.items()
    )


def test_errors_that_grow_from_turn_to_turn_cost_a_short_trial_and_no_whole_run(stepped) -> None:
    # at so loose a tolerance one turn of a Bennett linkage asks for some 50 steps, and there they do;
    # over ten turns they end in another assembly
    drive = catalog.make("bennett")
    tolerance = 2e-4 * drive.length0
    run = simulate(drive.mechanism, speed=SPEED, turns=TURNS, tolerance=tolerance)
    assert run.outcome == "passed"
    assert error(drive, run.motion) <= tolerance
    assert len(stepped) == 3
    assert run.tolerance_report.satisfied
    assert run.tolerance_report.trials == sum(stepped) - run.steps
    assert sum(stepped) <= 1.25 * run.steps
    coarse = Settings(steps_per_turn=stepped[1] // 2)
    short = simulate(drive.mechanism, speed=SPEED, turns=1.0, settings=coarse)
    long = simulate(drive.mechanism, speed=SPEED, turns=TURNS, settings=coarse)
    assert short.estimate <= tolerance
    assert long.estimate > 100.0 * tolerance


@pytest.mark.parametrize("name", ["four_bar", "rrsrr", "looper"])
@pytest.mark.parametrize("part", [1e-3, 3e-5])
def test_a_loose_tolerance_takes_fewer_steps_than_the_trial_and_one_whole_run(name, part, stepped) -> None:
    drive = catalog.make(name)
    tolerance = part * drive.crank
    run = simulate(drive.mechanism, speed=SPEED, turns=TURNS, tolerance=tolerance)
    assert run.outcome == "passed"
    assert error(drive, run.motion) <= tolerance
    assert sum(count > 5 * TRIAL_STEPS or count == run.steps for count in stepped) == 1
    assert run.steps < TURNS * TRIAL_STEPS


def test_a_short_run_is_not_tried_longer_than_it_is(stepped) -> None:
    run = simulate(catalog.make("four_bar").mechanism, speed=SPEED, turns=1.0, tolerance=1e-5)
    assert run.outcome == "passed"
    assert sum(stepped) <= TRIAL_STEPS + run.steps


def test_no_error_at_all_requests_for_the_fewest_steps() -> None:
    class Exact:
        profile = type("Profile", (), {"turns": TURNS})
        cycle, min_steps = 1.0, 1

        def over_first_turns(self, turns):
            part = Exact()
            part.profile = type("Profile", (), {"turns": turns})
            return part

        def errors_by_turn(self, _settings):
            return np.zeros(max(1, round(self.profile.turns)))

    assert position_tolerance.steps_needed(Exact(), Settings(), 1e-6)[0] == position_tolerance.MIN_STEPS


@pytest.mark.parametrize("reach", [0.1, 0.01])
def test_a_swing_of_less_than_a_turn_is_stepped_finely_enough(reach) -> None:
    drive = catalog.make("four_bar")
    run = simulate(drive.mechanism, profile=swing(1.0, reach, 60.0), tolerance=4e-10 * reach)
    assert run.outcome == "passed"
    assert error(drive, run.motion) <= run.tolerance


def test_a_swing_of_all_the_little_that_a_crank_can_move_keeps_its_tolerance() -> None:
    # over 0.0067 rad the follower leaves one dead centre and comes to the next
    drive = catalog.Looper(
        crank=0.0078268,
        coupler=0.0197878,
        arm=0.022136,
        arm_angle=6.192851,
        rocker=0.0332265,
        frame=0.045795,
        frame_angle=0.8204655,
        follower=0.0147708,
        axis_y=0.0196731,
        axis_z=0.0089396,
    )
    profile = within_range(drive.mechanism, drive.crank_range(), SPEED)
    run = simulate(drive.mechanism, profile=profile, tolerance=1e-11)
    assert run.outcome == "passed"
    assert error(drive, run.motion) <= 1e-11
    assert run.tolerance_report.trials < 2.0 * run.steps


def test_records_closer_than_the_trial_steps_do_not_hide_that_finer_steps_help() -> None:
    drive = catalog.make("rssr")
    run = simulate(drive.mechanism, speed=SPEED, tolerance=1e-12, samples=1000)
    assert run.outcome == "passed"
    assert run.steps % 1000 == 0


def test_a_trial_that_diverges_is_followed_by_finer_ones(tmp_path):
    path = tmp_path / "stiff.xml"
    path.write_text(FINGER.replace('damping="0.001"', 'damping="0.02"'))
    model = load(str(path), drive={"knuckle": "0.3*sin(2*pi*t)"}, duration=0.2)
    coarse = simulate(model, settings=Settings(steps_per_turn=100))
    assert coarse.outcome == "diverged"
    assert "stiffness" in coarse.motion.broken
    run = simulate(model, tolerance=1e-6)
    assert run.outcome == "passed"
    assert run.settings.steps_per_turn >= 1000
