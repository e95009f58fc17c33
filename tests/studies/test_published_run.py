"""`validate` of an MJCF file reports the file's own settings and checks them against a given tolerance."""

import json

import jsonschema
import mujoco
import numpy as np
import pytest
from valid_scene import changed

import mechsim as ms
from mechsim.cli.schema import output_schema
from mechsim.compare.quantities import stroke_of
from mechsim.studies.drawn_motion import drawn_motion
from mechsim.studies.scene.own_settings import published_scene
from mechsim.studies.validate import case_of, position_tolerance

LAW, DURATION = "0.3*sin(2*pi*t)", 0.5


def scene(folder, *changes):
    path = folder / "bar.xml"
    path.write_text(changed(*changes))
    return path


def loaded(path, law=LAW):
    return ms.load(path, drive={"crank": law}, duration=DURATION)


def plain_gap(path):
    """Return the largest loop-closure error over all steps in plain MuJoCo under the same control."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, largest = mujoco.MjData(model), 0.0
    sides = [("coupler", model.eq_data[0, :3]), ("rocker", model.eq_data[0, 3:6])]
    while data.time < DURATION - 1e-9:
        data.ctrl[0] = 0.3 * np.sin(2 * np.pi * data.time)
        mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        # positions of the current state and not of the start of the step
        first, second = (
            data.body(name).xpos + data.body(name).xmat.reshape(3, 3) @ anchor for name, anchor in sides
        )
        largest = max(largest, float(np.linalg.norm(first - second)))
    return largest


SOFT = ('solref="0.002 1"\n             solimp="0.9999 0.9999 0.001 0.5 2"', 'solref="0.02 1"')


@pytest.mark.long
def test_settings_of_a_file_that_drift_visibly_fail_with_the_remedy_first(tmp_path):
    path, fails = scene(tmp_path, SOFT), {}
    for time_constant in (0.02, 0.008):
        path.write_text(changed((SOFT[0], f'solref="{time_constant} 1"')))
        case = case_of(loaded(path))
        fails[time_constant] = not case.passed
        # gaps grow with the square of the time constant
        assert case.passed == (plain_gap(path) < 1e-4)
        assert case.findings[0].severity == ("warning" if case.passed else "error")
        if not case.passed:
            assert case.verdict.reason.startswith(f"as published: `mechsim tune {path}")
            assert case.findings[0].remedy in case.verdict.reason
    assert fails == {0.02: True, 0.008: False}


def test_a_drawn_motion_of_a_file_has_the_drift_of_its_own_settings(tmp_path):
    path = scene(tmp_path, SOFT)
    solver = loaded(path)
    motion = drawn_motion(solver, "simulated", solver.motion_laws.path_profile, 100)
    assert len(motion) == 101
    assert motion.closure.max() == pytest.approx(plain_gap(path), rel=0.05)
    sides = {}
    for name, x in (("coupler", 0.1), ("rocker", None)):
        model = mujoco.MjModel.from_xml_path(str(path))
        local = np.array([x, 0.0, 0.0]) if x else model.eq_data[0, 3:6]
        link = motion.links[name]
        sides[name] = link.position + link.rotation @ local
    gaps = np.linalg.norm(sides["coupler"] - sides["rocker"], axis=1)
    assert gaps == pytest.approx(motion.closure, abs=1e-9)
    # rates of links from differences agree with the exact rates once the loops have settled
    exact = solver.solve_as(motion)
    rate, reference = (record.links["coupler"].angular_velocity for record in (motion, exact))
    assert np.abs(rate[30:-1] - reference[30:-1]).max() < 0.02 * np.abs(reference).max()


@pytest.mark.long
def test_a_given_tolerance_applies_to_the_settings_of_the_file(tmp_path):
    path = scene(tmp_path, SOFT)
    wide = case_of(loaded(path), tolerance=1e-3)
    assert wide.passed, wide.verdict
    gap = wide.published.gap
    tight = case_of(loaded(path), tolerance=0.5 * gap)
    assert not tight.passed
    assert "as published" in tight.verdict.reason
    rows = {check.title: check for check in tight.verdict.checks if check.method == "as published"}
    assert rows["as published: loop residual"].worst == pytest.approx(gap)
    assert "timestep 1 ms" in rows["as published: loop residual"].reason


@pytest.mark.long
def test_a_file_that_diverges_with_its_own_settings_fails(tmp_path):
    path = scene(tmp_path, ('kp="10"', 'kp="1e7"'))
    case = case_of(loaded(path), tolerance=1e-3)
    assert case.published.note
    assert case.published.gap == np.inf
    assert case.verdict.outcome == "diverged"


@pytest.mark.long
def test_the_command_reports_both_runs_as_text_and_json(tmp_path, mechsim):
    path = scene(tmp_path, SOFT)
    arguments = ["validate", str(path), "--drive", f"crank={LAW}", "--duration", f"{DURATION}s"]
    for options, code in ((["--tolerance", "1mm"], 0), (["--tolerance", "1nm", "--json"], 1)):
        answer = mechsim(*arguments, *options)
        assert answer.code == code
        printed = answer.out
        if code == 0:
            assert "stepped with mechsim's settings" in printed
            assert "with the file's own settings (timestep 1 ms" in printed
            continue
        jsonschema.validate(json.loads(printed), output_schema("validate"))
        reported = json.loads(printed)["mechanisms"]["four-bar"]
        assert reported["published"]["loop_closure"] > 1e-6
        assert reported["findings"][0]["kind"] == "published"


def test_the_published_run_starts_at_the_requested_keyframe(tmp_path):
    first, _ = published_scene(loaded(scene(tmp_path)))
    start = " ".join(repr(float(value)) for value in first.closure.moved_to(first.start[0], {"crank": 0.5}))
    key = f'<keyframe><key name="out" qpos="{start}"/></keyframe></mujoco>'
    path = scene(tmp_path, ("</mujoco>", key))
    solver = ms.load(path, drive={"crank": "0.5 + 0.01*sin(2*pi*t)"}, duration=0.2, key="out")
    published, _ = published_scene(solver)
    assert published.start[0] == pytest.approx(solver.source.qpos, abs=1e-12)
    assert published.start[0][0] == pytest.approx(0.5)
    assert first.start[0][0] == 0.0


@pytest.mark.long
def test_a_valid_scene_passes_at_a_short_stroke(tmp_path):
    case = case_of(loaded(scene(tmp_path), "1e-3*sin(6*pi*t)"))
    assert case.passed, case.verdict


def test_the_default_tolerance_of_a_short_stroke_uses_the_size():
    solver = ms.catalog.make("four_bar")
    mechanism, motion = solver.mechanism, solver.solve([0.50, 0.51, 0.52])
    stroke, length = stroke_of(motion), mechanism.characteristic_length
    assert stroke < 0.01 * length
    result = position_tolerance(motion, mechanism)
    assert result.value == pytest.approx(1e-8 * length)
    assert "of the mechanism's size" in result.reason
    tiny = solver.solve([0.5, 0.5 + 1e-6])
    assert position_tolerance(tiny, mechanism).value == pytest.approx(1e-4 * stroke_of(tiny))
    assert position_tolerance(motion, mechanism, 1e-5).value == 1e-5
