import json

import mujoco
import pytest
from scene_texts import FINGER, FLOATING

from mechsim.errors import InputError


@pytest.fixture
def finger(tmp_path):
    (tmp_path / "finger.xml").write_text(FINGER)
    return "finger.xml"


def test_several_tracked_points_are_accepted(mechsim, finger, monkeypatch):
    tracked_names = []

    def stop(scene, *_, **__):
        tracked_names.extend(scene.tracked)
        raise InputError("seen")

    monkeypatch.setattr("mechsim.studies.reduction.search.reduce_scene", stop)
    arguments = ("--track", "pad,lever", "--track", "P,pad@0.1,0,0")
    assert mechsim("reduce", finger, "--tolerance", "7um", *arguments, "-o", "out.xml").code == 2
    assert tracked_names == ["pad", "lever", "P"]


@pytest.mark.slow
def test_locked_joints_and_a_fixed_base_stay_fixed_in_the_reduced_scene(mechsim, tmp_path):
    (tmp_path / "floating.xml").write_text(FLOATING)
    locks = ("--fix-base", "--lock", "swing=0.2", "--key", "home", "--ctrl", "servo=0.1")
    arguments = ("--duration", "0.1s", "--tolerance", "7um", "--track", "pad", "-o", "out.xml", "--json")
    answer = mechsim("reduce", "floating.xml", *locks, *arguments)
    assert answer.code == 0, answer.err
    assert json.loads(answer.out)["error"] <= 7e-6
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "out.xml"))
    assert not (model.jnt_type == mujoco.mjtJoint.mjJNT_FREE).any()
    pad = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, pad, 0)
    mujoco.mj_forward(model, pad)
    assert pad.body("pad").xpos[2] > 1.0  # pose of the keyframe and not of the reference configuration
