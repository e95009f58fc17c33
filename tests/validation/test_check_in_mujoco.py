"""The judge of tuned files, plain MuJoCo alone, agrees with the loop equations and rejects what is soft."""

import importlib
from pathlib import Path

import pytest
from scene_texts import scene

from mechsim.simulation.plain_settings import PlainSettings
from mechsim.studies.scene.converged_reference import LOWEST_COMPLIANCE_SOLIMP, compute_reference
from mechsim.studies.scene.errors import SceneEvaluator
from mechsim.studies.scene.run import run_scene
from mechsim.studies.scene.write_tuned import python_of, tuned_text, write_scene

MOTION = "0.5*sin(2*pi*t)"
HARD = PlainSettings(
    timestep=0.001, integrator="implicitfast", solref=(0.003, 1.0), solimp=LOWEST_COMPLIANCE_SOLIMP
)


@pytest.fixture
def judge(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "validation" / "choices"))
    return importlib.import_module("check_in_mujoco")


@pytest.fixture
def tuned_script(tmp_path):
    """Return a scene and the script that was written for it."""
    item = scene(tmp_path, drive={"knuckle": MOTION}, duration=0.2)
    outside = write_scene(item, HARD, tuned_text(item, HARD, [], tmp_path).after, tmp_path / "out.xml")
    (tmp_path / "run.py").write_text(python_of(outside, tmp_path / "out.xml", {"knuckle": MOTION}))
    return item, tmp_path / "run.py"


def test_what_plain_mujoco_closes_is_what_the_loop_equations_close(judge, tuned_script):
    item, path = tuned_script
    known = SceneEvaluator().errors(run_scene(item, HARD.applied(item.model), records=None)).closure
    script = judge.script_of(path)
    result = judge.closure_error(script, item.duration, item.tracked, item.closure.drivers)
    assert result == pytest.approx(known, rel=1e-6)
    script.model.eq_solref[:], script.model.eq_solimp[:] = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
    assert judge.closure_error(script, item.duration, item.tracked, item.closure.drivers) > 100.0 * known


def test_a_run_of_small_steps_reports_a_trajectory_as_the_limit_of_the_scene_does(judge, tuned_script):
    item, path = tuned_script
    evaluator = SceneEvaluator(compute_reference(item, 1e-9).run)
    known = evaluator.errors(run_scene(item, HARD.applied(item.model), records=None)).trajectory
    result, own = judge.trajectory_error(judge.script_of(path), item.duration, item.tracked)
    assert own < 0.2 * result  # of steps sixteen times smaller a sixteenth is left
    assert result == pytest.approx(known, rel=0.15)
