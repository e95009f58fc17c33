"""Exported turning models, stepped in plain MuJoCo and compared with the closed form."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from mechsim import catalog
from mechsim.errors import InputError
from mechsim.model.scene import Scene
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.studies.export import exported
from mechsim.studies.scene import tune_model
from mechsim.subjects.readers import load

SPEED = 60.0


def position_error(model, solver, turns=3.0):
    """Step a model from its keyframe; return its largest position error and the last crank angle."""
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    angles, positions = [], {name: [] for name in solver.mechanism.points}
    crank = model.joint("crank").qposadr[0]
    for _ in range(round(turns * 2.0 * np.pi / SPEED / model.opt.timestep)):
        mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        angles.append(data.qpos[crank])
        for name, item in positions.items():
            item.append(data.site(name).xpos.copy())
    exact = solver.positions(np.array(angles))
    gaps = [np.linalg.norm(np.array(positions[name]) - exact[name], axis=1).max() for name in exact]
    return max(gaps), angles[-1]


@pytest.mark.slow
def test_an_exported_model_satisfies_its_stated_tolerance():
    solver = catalog.make("four_bar")
    spec = exported(solver.mechanism, Scene())
    text, reported = tune_model.exported_model(spec, solver.mechanism, SPEED, 1e-5, budget=2.0)
    assert "satisfies 1e-05 m at 60 rad/s" in text
    assert "keyframe turning" in text
    model = mujoco.MjModel.from_xml_string(text)
    error, angle = position_error(model, solver)
    assert error <= 1e-5
    assert error == pytest.approx(reported, rel=0.5)
    assert angle - model.key_qpos[0][model.joint("crank").qposadr[0]] == pytest.approx(6.0 * np.pi, rel=1e-2)
    # the check rejects loops with MuJoCo's default compliance
    model.eq_solref[:], model.eq_solimp[:] = [0.02, 1.0], [0.9, 0.95, 0.001, 0.5, 2.0]
    assert position_error(model, solver)[0] > 1e-5


def test_the_keyframe_is_closed_and_the_motor_keeps_the_speed():
    solver = catalog.make("four_bar")
    spec = tune_model.turning(exported(solver.mechanism, Scene(level="dynamics")), solver.mechanism, SPEED)
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
    mechanism = load("five_bar").mechanism
    with pytest.raises(InputError, match="has no single crank that can turn"):
        tune_model.turning(exported(mechanism, Scene()), mechanism, SPEED)


@pytest.mark.parametrize("scene", ["motion", "dynamics"])
def test_a_driver_with_another_name_turns(scene):
    mechanism = load("planetary_gear").mechanism
    assert mechanism.crank.name == "carrier"
    spec = tune_model.turning(exported(mechanism, Scene(level=scene)), mechanism, SPEED)
    model = mujoco.MjModel.from_xml_string(to_xml(spec))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(round(2.0 * np.pi / SPEED / model.opt.timestep)):
        mujoco.mj_step(model, data)
    assert data.qvel[model.joint("crank").dofadr[0]] == pytest.approx(SPEED, rel=0.05)
    # Willis equation: relative to the carrier the sun turns by the ratio of teeth of ring and sun
    sun = data.qvel[model.joint("sun").dofadr[0]] / data.qvel[model.joint("crank").dofadr[0]]
    assert sun == pytest.approx(60.0 / 24.0, rel=1e-3)


@pytest.mark.slow
def test_an_exported_planetary_gear_satisfies_its_tolerance():
    mechanism = load("planetary_gear").mechanism
    text, error = tune_model.exported_model(exported(mechanism, Scene()), mechanism, SPEED, 1e-5, budget=1.0)
    assert error <= 1e-5
    assert "satisfies 1e-05 m" in text


def test_a_passive_joint_named_crank_is_rejected():
    four_bar = catalog.make("four_bar").mechanism
    names = {"crank": "motor", "A": "crank"}
    joints = tuple(replace(joint, name=names.get(joint.name, joint.name)) for joint in four_bar.joints)
    other = replace(four_bar, joints=joints, driver="motor")
    with pytest.raises(InputError, match=r"joint 'crank' is not the driver.*; rename the joint$"):
        exported(other, Scene())
