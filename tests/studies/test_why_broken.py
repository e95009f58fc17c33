"""What made a scene diverge is named: each cause is made, and told from the others."""

import pytest
from scene_texts import FINGER, scene

from mechsim.studies.scenes import stepped
from mechsim.studies.scenes.plain_settings import PlainSettings
from mechsim.studies.scenes.why_broken import why_broken
from mechsim.studies.tuning.finer_steps import finer

FED = {"servo": "0.5*sin(2*pi*t)"}
RINGING = PlainSettings(integrator="RK4", solref=(-1e9, -1.0), solimp=(0.9999, 0.9999, 0.001, 0.5, 2.0))


def broken(folder, text=FINGER, settings=RINGING, **motion):
    one = scene(folder, text=text, **(motion or {"ctrl": FED}))
    run = stepped(one, settings.applied(one.model))
    assert run.broken
    return why_broken(run)


def test_a_step_too_long_for_a_damper_is_stiffness(tmp_path):
    stiff = FINGER.replace('damping="0.001"', 'damping="0.02"')
    assert "stiffness: a step 8 times smaller" in broken(
        tmp_path, stiff, PlainSettings(integrator="RK4", timestep=5e-4)
    )


def test_a_joint_at_the_end_of_its_range_is_a_limit(tmp_path):
    limited = FINGER.replace(
        '<joint name="swing"',
        '<joint name="swing" limited="true" range="-0.001 0.001" solreflimit="-1e12 -1"',
    )
    found = broken(tmp_path, limited, PlainSettings(refsafe=False), ctrl={"servo": "5*sin(20*t)"})
    assert "a limit" in found
    assert "swing" in found


def test_a_run_that_is_one_has_no_cause(tmp_path):
    assert why_broken(stepped(scene(tmp_path, ctrl=FED))) == ""


def test_a_run_that_diverges_is_followed_by_finer_ones(tmp_path):
    one = scene(tmp_path, ctrl=FED, text=FINGER.replace('damping="0.001"', 'damping="0.02"'))
    coarse = PlainSettings(integrator="RK4", timestep=5e-4)
    run, errors, _ = finer(one, coarse, 1e-5, fixed=True)
    assert run.broken
    run, errors, used = finer(one, coarse, 1e-5)
    assert not run.broken
    assert errors.closure <= 1e-5
    assert used.timestep < 5e-4


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6])
def test_the_steps_are_no_finer_than_a_tolerance_asks_for(tmp_path, tolerance):
    one = scene(tmp_path, drive={"knuckle": "0.5*sin(2*pi*t)"})
    _, errors, used = finer(one, PlainSettings(timestep=0.002), tolerance)
    assert errors.closure <= tolerance
    assert used.timestep >= (2e-3 if tolerance == 1e-4 else 5e-4)
