"""The plain-MuJoCo check of tuned files agrees with the loop equations and rejects compliant loops."""

import check_in_mujoco as check
import pytest
from scene_texts import scene

from mechsim.simulation.plain_settings import PlainSettings
from mechsim.studies.scene.converged_reference import LOWEST_COMPLIANCE_SOLIMP, compute_reference
from mechsim.studies.scene.errors import SceneEvaluator
from mechsim.studies.scene.run import run_scene
from mechsim.studies.scene.write_tuned import python_of, tuned_text, write_scene

MOTION = "0.5*sin(2*pi*t)"
STIFF = PlainSettings(
    timestep=0.001, integrator="implicitfast", solref=(0.003, 1.0), solimp=LOWEST_COMPLIANCE_SOLIMP
)


@pytest.fixture
def tuned_script(tmp_path):
    """Return a scene and the script written for it."""
    item = scene(tmp_path, drive={"knuckle": MOTION}, duration=0.2)
    written = write_scene(item, STIFF, tuned_text(item, STIFF, [], tmp_path).after, tmp_path / "out.xml")
    (tmp_path / "run.py").write_text(python_of(written, tmp_path / "out.xml", {"knuckle": MOTION}))
    return item, tmp_path / "run.py"


def test_closure_errors_agree_with_the_loop_equations(tuned_script):
    item, path = tuned_script
    reference = SceneEvaluator().errors(run_scene(item, STIFF.applied(item.model), records=None)).closure
    script = check.script_of(path)
    result = check.closure_error(script, item.duration, item.tracked, item.closure.drivers)
    assert result == pytest.approx(reference, rel=1e-6)
    script.model.eq_solref[:], script.model.eq_solimp[:] = (0.02, 1.0), (0.9, 0.95, 0.001, 0.5, 2.0)
    assert check.closure_error(script, item.duration, item.tracked, item.closure.drivers) > 100.0 * reference


def test_trajectory_errors_agree_with_the_scene_evaluator(tuned_script):
    item, path = tuned_script
    evaluator = SceneEvaluator(compute_reference(item, 1e-9).run)
    reference = evaluator.errors(run_scene(item, STIFF.applied(item.model), records=None)).trajectory
    result, reference_error = check.trajectory_error(check.script_of(path), item.duration, item.tracked)
    assert reference_error < 0.2 * result  # steps sixteen times smaller leave a sixteenth of the error
    assert result == pytest.approx(reference, rel=0.15)
