import json

import mujoco
import pytest
from scene_texts import FINGER, FLOATING
from studies.test_reduction import few_trials

from mechsim.errors import InputError

FED = ("--ctrl", "servo=0.5*sin(2*pi*t)", "--duration", "0.2s")


@pytest.fixture
def finger(tmp_path):
    (tmp_path / "finger.xml").write_text(FINGER)
    return "finger.xml"


def test_reduce_writes_a_scene_and_reports_what_each_thing_left_out_costs(
    mechsim, finger, tmp_path, monkeypatch
):
    few_trials(monkeypatch)
    output = mechsim(
        "reduce", finger, "--tolerance", "7um", "--track", "pad", *FED, "-o", "out.xml", "--json"
    )
    assert output.code == 0, output.err
    reported = json.loads(output.out)
    assert reported["error"] <= 7e-6
    assert {"what", "error", "time_ratio"} <= set(reported["left_out"][0])
    text = (tmp_path / "out.xml").read_text()
    assert text.startswith("<!--")
    assert all(item["what"] in text for item in reported["left_out"])


def test_two_points_may_be_named_at_once(mechsim, finger, monkeypatch):
    asked = []

    def stopped(scene, *_, **__):
        asked.extend(scene.tracked)
        raise InputError("seen")

    monkeypatch.setattr("mechsim.studies.reduction.reduce_model.reduce_scene", stopped)
    words = ("--track", "pad,lever", "--track", "P,pad@0.1,0,0")
    assert mechsim("reduce", finger, "--tolerance", "7um", *words, "-o", "out.xml").code == 2
    assert asked == ["pad", "lever", "P"]


@pytest.mark.slow
def test_what_is_held_stands_still_in_what_is_left(mechsim, tmp_path, monkeypatch):
    few_trials(monkeypatch)
    (tmp_path / "floating.xml").write_text(FLOATING)
    held = ("--fix-base", "--lock", "swing=0.2", "--key", "home", "--ctrl", "servo=0.1")
    words = ("--duration", "0.1s", "--tolerance", "7um", "--track", "pad", "-o", "out.xml", "--json")
    answer = mechsim("reduce", "floating.xml", *held, *words)
    assert answer.code == 0, answer.err
    assert json.loads(answer.out)["error"] <= 7e-6
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    assert not (model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).any()
    pad = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, pad, 0)
    mujoco.mj_forward(model, pad)
    assert pad.body("pad").xpos[2] > 1.0  # where the base is held, not in the reference configuration


@pytest.mark.parametrize(
    ("words", "output"),
    [
        (("--tolerance", "0"), "above 0"),
        (("--tolerance", "7um", "--by", "closure"), "choose from trajectory, torque"),
        (("--tolerance", "7um", "--ctrl", "motor=1"), "actuators of the model are servo"),
        (("--tolerance", "7um", "--track", "nail"), "nail"),
    ],
)
def test_reduce_rejects_in_one_line_and_writes_nothing(mechsim, finger, tmp_path, words, output):
    answer = mechsim("reduce", finger, *words, "-o", "out.xml")
    assert answer.code == 2
    assert output in answer.err
    assert len(answer.err.strip().splitlines()) == 1
    assert not (tmp_path / "out.xml").exists()
