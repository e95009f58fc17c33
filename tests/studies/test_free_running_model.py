"""Exported turning models, stepped in plain MuJoCo and compared with the closed form."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

import mechsim as ms
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.studies.export import exported
from mechsim.studies.scene import tune_model

SPEED = 60.0


def test_the_keyframe_is_closed_and_the_motor_keeps_the_speed():
    solver = ms.catalog.make("four_bar")
    spec = tune_model.turning(exported(solver.mechanism, ms.Scene(level="dynamics")), solver.mechanism, SPEED)
    model = mujoco.MjModel.from_xml_string(to_xml(spec))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
    assert np.abs(data.efc_pos[rows]).max() < 1e-15
    assert np.abs(data.efc_vel[rows]).max() < 1e-12
    dof = model.joint("crank").dofadr[0]
    assert data.qvel[dof] == SPEED
    for _ in range(round(2.0 * np.pi / SPEED / model.opt.timestep)):
        mujoco.mj_step(model, data)
        assert 0.5 * SPEED < data.qvel[dof] < 1.5 * SPEED


def test_a_turning_model_with_several_drivers_is_rejected():
    mechanism = ms.load("five_bar").mechanism
    with pytest.raises(ms.InputError, match="has no single crank that can turn"):
        tune_model.turning(exported(mechanism, ms.Scene()), mechanism, SPEED)


@pytest.mark.parametrize("scene", ["motion", "dynamics"])
def test_a_driver_with_another_name_turns(scene):
    mechanism = ms.load("planetary_gear").mechanism
    assert mechanism.crank.name == "carrier"
    spec = tune_model.turning(exported(mechanism, ms.Scene(level=scene)), mechanism, SPEED)
    model = mujoco.MjModel.from_xml_string(to_xml(spec))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(round(2.0 * np.pi / SPEED / model.opt.timestep)):
        mujoco.mj_step(model, data)
    assert data.qvel[model.joint("crank").dofadr[0]] == pytest.approx(SPEED, rel=0.05)
    # Willis equation: relative to the carrier the sun turns by the ratio of teeth of ring and sun
    sun = data.qvel[model.joint("sun").dofadr[0]] / data.qvel[model.joint("crank").dofadr[0]]
    assert sun == pytest.approx(60.0 / 24.0, rel=1e-3)


def test_a_passive_joint_may_be_named_crank():
    four_bar = ms.catalog.make("four_bar").mechanism
    names = {"crank": "motor", "A": "crank"}
    joints = tuple(replace(joint, name=names.get(joint.name, joint.name)) for joint in four_bar.joints)
    other = replace(four_bar, joints=joints, driver="motor")
    assert ms.validate(other).passed
    table = ms.joint_map(other, {"motor": (0.3, 0.6)}, ["crank"])
    assert table.output[:, 0] == pytest.approx(
        ms.joint_map(four_bar, {"crank": (0.3, 0.6)}, ["A"]).output[:, 0]
    )


def test_angles_of_a_file_in_degrees_are_written_in_radians():
    joint = '<joint name="j" range="-30.125 40" limited="true" ref="5.5" springref="7.25" stiffness="2"/>'
    text = f'<mujoco><worldbody><body name="b">{joint}<geom size=".1"/></body></worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(text)
    written = mujoco.MjModel.from_xml_string(to_xml(mujoco.MjSpec.from_string(text)))
    for name in ("qpos0", "qpos_spring", "jnt_range"):
        np.testing.assert_allclose(getattr(written, name), getattr(model, name), rtol=1e-14)
