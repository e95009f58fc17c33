"""Models in the style of Menagerie: servos hold a closed home, and their numbers reject a wrong model."""

import mujoco
import numpy as np
import pytest

import mechsim as ms
from mechsim.studies.robots.menagerie import verification


@pytest.fixture(scope="module")
def ankle():
    return ms.export("humanoid_ankle", style="menagerie")


def test_the_model_is_that_of_the_loop_equations(ankle):
    assert ankle.verification.configurations == 100
    assert ankle.verification.position < 1e-13
    assert ankle.verification.gravity_torque < 1e-12
    assert "100 seeded random configurations" in ankle.verification.markdown()


def test_servos_hold_the_closed_keyframe_and_follow_their_control(ankle):
    model = mujoco.MjModel.from_xml_string(ankle.text)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
    assert model.nu == 2
    mujoco.mj_forward(model, data)
    rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    assert np.abs(data.efc_pos[rows]).max() < 1e-12
    target = data.ctrl + np.array([0.1, -0.05])
    data.ctrl[:] = target
    for _ in range(1000):
        mujoco.mj_step(model, data)
    reached = [data.joint(model.actuator(i).name).qpos[0] for i in range(2)]
    assert reached == pytest.approx(target.tolist(), abs=0.02)
    assert np.abs(data.qvel).max() < 1e-2


def test_a_wrong_model_is_noticed(ankle):
    solver = ms.load("humanoid_ankle")
    model = mujoco.MjSpec.from_string(ankle.text)
    foot = model.body("foot")
    foot.mass = 1.01 * foot.mass
    assert verification(model.to_xml(), solver).gravity_torque > 1e-5
    model.body("foot").sites[0].pos[0] += 1e-6
    assert verification(model.to_xml(), solver).position > 1e-7


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"style": "fancy"}, "no style 'fancy'"),
        ({"style": "menagerie", "format": "toml"}, "leave out"),
        ({"style": "menagerie", "speed": "60rpm"}, "leave out"),
    ],
)
def test_wrong_options_end_in_one_sentence(options, message):
    with pytest.raises(ms.InputError, match=message):
        ms.export("four_bar", **options)
