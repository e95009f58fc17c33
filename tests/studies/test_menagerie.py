"""Models in the style of Menagerie: servos hold the home keyframe."""

import mujoco
import numpy as np
import pytest
from model_files import model_text

import mechsim as ms


@pytest.fixture(scope="module")
def ankle():
    return ms.export("humanoid_ankle", style="menagerie")


@pytest.mark.long
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


WITH_SPRING = model_text("menagerie_with_spring.xml")


@pytest.mark.slow
def test_a_file_keeps_the_names_limits_and_springs_of_its_joints():
    written = ms.export(mujoco.MjSpec.from_string(WITH_SPRING), style="menagerie")
    model = mujoco.MjModel.from_xml_string(written.text)
    assert model.nu == 1
    assert model.actuator(0).name == "motor"
    np.testing.assert_allclose(model.joint("motor").range, [-0.5, 1.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(model.joint("hip").range, [-2.0, 2.0], rtol=0, atol=1e-12)
    assert np.ravel(model.joint("hip").stiffness)[0] == 0.05
    # without a virtual drive inertia the gain is that of a small mechanism
    assert model.dof_armature.max() == 0.0
    assert model.actuator_gainprm[0, 0] < 10.0
