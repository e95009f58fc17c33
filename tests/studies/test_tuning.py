import importlib.util
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scene_texts import CONTROL, FINGER, scene

from mechsim.errors import InputError
from mechsim.simulation.plain_settings import PlainSettings, settings_of
from mechsim.studies.scene.errors import SceneErrors, SceneEvaluator
from mechsim.studies.scene.run import run_scene
from mechsim.studies.scene.step_sizes import disabled, shortest_time_constant, steps_of
from mechsim.studies.scene.tune import AIMED_FRACTION, tuned
from mechsim.studies.scene.write_tuned import KEY, differing, python_of, tuned_text, write_scene

STIFF = PlainSettings(
    timestep=0.001,
    integrator="implicitfast",
    iterations=3,
    solref=(0.003, 1.0),
    solimp=(0.9999, 0.9999, 0.001, 0.5, 2.0),
    refsafe=False,
)


def test_settings_of_a_model_round_trip_without_changes(controlled):
    model = STIFF.applied(controlled.model)
    reported = settings_of(model)
    assert {name: getattr(reported, name) for name in STIFF.as_dict()} == STIFF.as_dict()
    assert STIFF.changes_to(model) == PlainSettings()
    assert controlled.model.opt.timestep == 0.002  # only the copy is changed


@pytest.mark.long
def test_a_search_ends_with_its_budget(driven):
    result = tuned(replace(driven, duration=0.05), 1e-14, budget=1e-3)
    assert result.chosen is None
    assert len(result.tried) == 1


@pytest.mark.parametrize("which", ["controlled", "driven"])
def test_a_tuned_file_reproduces_the_measured_run(which, request, tmp_path):
    item = request.getfixturevalue(which)
    text = tuned_text(item, STIFF, ["a comment"], tmp_path)
    written = write_scene(item, STIFF, text.after, tmp_path / "out.xml")
    expected = run_scene(item, STIFF.applied(item.model), records=None)
    assert np.abs(run_scene(written, records=None).qpos - expected.qpos).max() < 1e-12
    assert "a four-bar under a position servo" in text.after
    assert set(FINGER.splitlines()) - set(text.after.splitlines()) <= {
        line
        for line in FINGER.splitlines()
        if any(word in line for word in ("option", "equality", "knuckle"))
    }


def test_a_text_with_other_settings_is_rejected_and_not_written(controlled, tmp_path):
    text = tuned_text(controlled, STIFF, [], tmp_path).after.replace("implicitfast", "RK4")
    with pytest.raises(InputError, match="differs in option integrator"):
        write_scene(controlled, STIFF, text, tmp_path / "out.xml")
    assert not [*tmp_path.iterdir()]


def test_a_difference_in_mass_is_detected(controlled):
    other = mujoco.MjModel.from_xml_string(FINGER.replace('mass="0.03"', 'mass="0.031"', 1))
    assert "body_mass" in differing(controlled.model, other)
    assert not differing(controlled.model, mujoco.MjModel.from_xml_string(FINGER))


def test_the_python_script_reproduces_the_run(driven, tmp_path):
    settings = replace(STIFF, integrator="RK4")
    write_scene(driven, settings, tuned_text(driven, settings, [], tmp_path).after, tmp_path / "out.xml")
    tuned_scene = replace(driven, model=settings.applied(driven.model), key=KEY)
    lines = python_of(tuned_scene, tmp_path / "out.xml", {"knuckle": "0.5*sin(2*pi*t)"})
    (tmp_path / "run.py").write_text(lines)
    spec = importlib.util.spec_from_file_location("tuned_run", tmp_path / "run.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    states = np.array([data.qpos.copy() for data in module.steps()])
    expected = run_scene(replace(tuned_scene, key=None), records=None)
    assert np.abs(states - expected.qpos[1:]).max() < 1e-8


def test_steps_do_not_increase_the_compliance_of_a_limit(tmp_path):
    limited = FINGER.replace('<joint name="swing"', '<joint name="swing" range="-1 1" solreflimit="0.006 1"')
    limited = limited.replace("<option", '<compiler angle="radian" autolimits="true"/><option')
    item = scene(tmp_path, ctrl=CONTROL, text=limited)
    assert shortest_time_constant(item.model) == 0.006
    assert steps_of(item)[0] <= 0.003
    assert shortest_time_constant(mujoco.MjModel.from_xml_string(FINGER)) == np.inf


LIMITED = FINGER.replace(
    '<joint name="pivot"/>', '<joint name="pivot" limited="true" range="-{most} 60" solreflimit="0.006 1"/>'
)


@pytest.mark.slow
@pytest.mark.parametrize(("most", "same"), [(60, True), (5, False)])
def test_an_allowed_limit_is_disabled_only_if_never_reached(tmp_path, most, same):
    item = scene(tmp_path, ctrl=CONTROL, text=LIMITED.replace("{most}", str(most)), duration=0.2)
    item = replace(item, allowed=("limits",))
    assert steps_of(item)[0] > 0.003  # the limit may become more compliant
    result = tuned(item, 1e-4, budget=60.0)
    disabled_trials = [trial for trial in result.tried if trial.settings.limit is False]
    assert disabled_trials
    assert any(trial.errors.trajectory < 1e-3 for trial in disabled_trials) == same
    assert same or result.chosen.settings.limit is None
    text = tuned_text(item, disabled_trials[0].settings, [], tmp_path).after
    assert 'limit="disable"' in text
    assert not disabled(replace(item, allowed=()))


@pytest.mark.long
@pytest.mark.parametrize("still", [True, False])
def test_settings_for_a_scene_at_rest_are_called_so(still, tmp_path):
    weightless = FINGER.replace("<option", '<option gravity="0 0 0"')
    item = scene(tmp_path, text=weightless, ctrl={"servo": "0" if still else "0.5*sin(6*t)"}, duration=0.2)
    result = replace(tuned(item, 1e-4, budget=1e-3), errors=SceneErrors(0.0, 0.0, 0.0))
    result = replace(result, chosen=replace(result.published, settings=STIFF))
    assert any("for a scene at rest" in sentence for sentence in result.sentences) == still


@pytest.mark.slow
def test_a_search_satisfies_a_tolerance_that_the_file_exceeds(driven):
    result = tuned(replace(driven, duration=0.1), 5e-6, budget=60.0)
    assert result.published.errors.closure > 5e-6
    assert result.chosen.errors.closure <= AIMED_FRACTION * 5e-6
    errors_at_every_step = SceneEvaluator().errors(
        run_scene(driven, result.chosen.settings.applied(driven.model), records=None)
    )
    assert errors_at_every_step.closure <= 5e-6
