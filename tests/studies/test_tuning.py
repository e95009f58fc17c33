import importlib.util
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scene_texts import FINGER, scene

from mechsim.errors import InputError
from mechsim.simulation.plain_settings import PlainSettings, settings_of
from mechsim.studies.scene.errors import SceneEvaluator
from mechsim.studies.scene.run import run_scene
from mechsim.studies.scene.step_sizes import disabled, shortest_time_constant, steps_of
from mechsim.studies.scene.tune import AIMED_FRACTION, tuned
from mechsim.studies.scene.write_tuned import KEY, differing, python_of, tuned_text, write_scene

FED, DRIVEN = {"servo": "0.5*sin(2*pi*t)"}, {"knuckle": "0.5*sin(2*pi*t)"}
HARD = PlainSettings(
    timestep=0.001,
    integrator="implicitfast",
    iterations=3,
    solref=(0.003, 1.0),
    solimp=(0.9999, 0.9999, 0.001, 0.5, 2.0),
    refsafe=False,
)


@pytest.fixture(scope="module")
def fed(tmp_path_factory):
    return scene(tmp_path_factory.mktemp("fed"), ctrl=FED)


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    return scene(tmp_path_factory.mktemp("driven"), drive=DRIVEN)


def test_settings_are_what_a_model_has_and_those_it_has_are_idle(fed):
    model = HARD.applied(fed.model)
    reported = settings_of(model)
    assert {name: getattr(reported, name) for name in HARD.as_dict()} == HARD.as_dict()
    assert HARD.changes_to(model) == PlainSettings()
    assert fed.model.opt.timestep == 0.002  # the copy alone is changed


def test_a_search_whose_time_is_up_tries_nothing_more(driven):
    # what keeps no tolerance is looked for among loops harder than a file can say, as long as there is time
    result = tuned(replace(driven, duration=0.05), 1e-14, budget=1e-3)
    assert result.chosen is None
    assert len(result.tried) == 1


@pytest.mark.parametrize("which", ["fed", "driven"])
def test_a_tuned_file_is_what_was_run(which, request, tmp_path):
    item = request.getfixturevalue(which)
    text = tuned_text(item, HARD, ["a comment"], tmp_path)
    outside = write_scene(item, HARD, text.after, tmp_path / "out.xml")
    meant = run_scene(item, HARD.applied(item.model), records=None)
    assert np.abs(run_scene(outside, records=None).qpos - meant.qpos).max() < 1e-12
    assert "a four-bar under a position servo" in text.after
    assert set(FINGER.splitlines()) - set(text.after.splitlines()) <= {
        line
        for line in FINGER.splitlines()
        if any(word in line for word in ("option", "equality", "knuckle"))
    }


def test_a_text_that_states_something_else_is_rejected_and_nothing_is_left(fed, tmp_path):
    text = tuned_text(fed, HARD, [], tmp_path).after.replace("implicitfast", "RK4")
    with pytest.raises(InputError, match="differs in option integrator"):
        write_scene(fed, HARD, text, tmp_path / "out.xml")
    assert not [*tmp_path.iterdir()]


def test_models_that_differ_in_a_mass_differ(fed):
    other = mujoco.MjModel.from_xml_string(FINGER.replace('mass="0.03"', 'mass="0.031"', 1))
    assert "body_mass" in differing(fed.model, other)
    assert not differing(fed.model, mujoco.MjModel.from_xml_string(FINGER))


def test_the_script_does_in_python_what_was_intended(driven, tmp_path):
    settings = replace(HARD, compliance=1e-4, integrator="RK4")
    plain = replace(settings, compliance=None, integrator=None)
    write_scene(driven, plain, tuned_text(driven, plain, [], tmp_path).after, tmp_path / "out.xml")
    stands = replace(driven, model=settings.applied(driven.model), key=KEY)
    changed = {"compliance": 1e-4, "integrator": "RK4"}
    lines = python_of(stands, tmp_path / "out.xml", {"knuckle": "0.5*sin(2*pi*t)"}, changed=changed)
    (tmp_path / "run.py").write_text(lines)
    spec = importlib.util.spec_from_file_location("tuned_run", tmp_path / "run.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    states = np.array([data.qpos.copy() for data in module.steps()])
    meant = run_scene(replace(stands, key=None), records=None)
    assert np.abs(states - meant.qpos[1:]).max() < 1e-8


def test_no_step_is_so_long_that_a_limit_gets_softer(tmp_path):
    limited = FINGER.replace('<joint name="swing"', '<joint name="swing" range="-1 1" solreflimit="0.006 1"')
    limited = limited.replace("<option", '<compiler angle="radian" autolimits="true"/><option')
    item = scene(tmp_path, ctrl=FED, text=limited)
    assert shortest_time_constant(item.model) == 0.006
    assert steps_of(item)[0] <= 0.003
    assert shortest_time_constant(mujoco.MjModel.from_xml_string(FINGER)) == np.inf


LIMITED = FINGER.replace(
    '<joint name="pivot"/>', '<joint name="pivot" limited="true" range="-{most} 60" solreflimit="0.006 1"/>'
)


@pytest.mark.slow
@pytest.mark.parametrize(("most", "same"), [(60, True), (5, False)])
def test_a_limit_that_is_freed_is_switched_off_only_where_it_is_not_met(tmp_path, most, same):
    item = scene(tmp_path, ctrl=FED, text=LIMITED.replace("{most}", str(most)), duration=0.2)
    item = replace(item, allowed=("limits",))
    assert steps_of(item)[0] > 0.003  # it may become softer
    result = tuned(item, 1e-4, budget=60.0)
    off = [trial for trial in result.tried if trial.settings.limit is False]
    assert off
    assert any(trial.errors.trajectory < 1e-3 for trial in off) == same
    assert same or result.chosen.settings.limit is None
    text = tuned_text(item, off[0].settings, [], tmp_path).after
    assert 'limit="disable"' in text
    assert not disabled(replace(item, allowed=()))


@pytest.mark.slow
def test_a_search_keeps_the_tolerance_for_less_than_the_file_as_it_is(driven):
    result = tuned(replace(driven, duration=0.1), 5e-6, budget=60.0)
    assert result.published.errors.closure > 5e-6
    assert result.chosen.errors.closure <= AIMED_FRACTION * 5e-6
    assert result.chosen.settings.in_file
    assert result.beyond is None
    again = SceneEvaluator().errors(
        run_scene(driven, result.chosen.settings.applied(driven.model), records=None)
    )
    assert again.closure <= 5e-6


@pytest.mark.slow
def test_settings_that_fail_at_every_step_do_not_hide_others_that_stand(tmp_path):
    # the cheapest two dozen satisfy 5 um at 400 instants, but not at every step of a longer motion
    result = tuned(scene(tmp_path, ctrl=FED, duration=0.5), 5e-6, budget=8.0)
    assert result.chosen is not None
    assert not result.satisfied
    assert result.chosen.seconds < 0.5 * result.closest.seconds
