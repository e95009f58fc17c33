"""Locked ball joints and free bodies keep MuJoCo's initial pose in every method."""

import mujoco
import numpy as np
import pytest
from model_files import FOLDER
from wheel_linkages import about_z

from mechsim import simulate
from mechsim.cli.options import ControlOptions, DriveOptions
from mechsim.cli.scene_run import user_scene
from mechsim.errors import InputError
from mechsim.io.readers import load
from mechsim.simulation.plain_settings import PlainSettings
from mechsim.studies.scene.scene import spec_of
from mechsim.studies.scene.write_tuned import tuned_text, write_scene

# a post on a hinge, a ball and a slide with inclined axes, an arm on the post, and a free body
BOOM = str(FOLDER / "locked_ball_joints_boom.xml")
LOCKED = ("lift", "neck", "rail", "loose")


def tip(key, rotation):
    """Return the tip by MuJoCo's kinematics of the whole file, the crank rotated from its start."""
    model = mujoco.MjModel.from_xml_path(BOOM)
    data = mujoco.MjData(model)
    if key is not None:
        mujoco.mj_resetDataKeyframe(model, data, model.key(key).id)
    data.joint("crank").qpos += rotation
    mujoco.mj_kinematics(model, data)
    return data.site("tip").xpos.copy()


@pytest.mark.parametrize("key", [None, "k"])
def test_locked_ball_and_free_joints_keep_their_initial_pose(key):
    solver = load(BOOM, drive={"crank": "0.5*t"}, lock=LOCKED, key=key)
    initial = float(solver.motion_laws.first["crank"])
    crank_start = 0.0 if key is None else 0.7
    poses = solver.solve(t=np.array([0.0, 1.0])).points["tip"].position
    for method in ("pose", "step"):
        run = simulate(solver, method=method)
        assert run.outcome == "passed"
        np.testing.assert_allclose(run.motion.points["tip"].position[-1], poses[-1], atol=1e-7)
        np.testing.assert_allclose(run.motion.points["tip"].position[0], poses[0], atol=1e-14)
    for rotation, position in ((0.0, poses[0]), (0.5, poses[1])):
        np.testing.assert_allclose(position, tip(key, initial - crank_start + rotation), atol=1e-14)


@pytest.mark.parametrize("key", [None, "k"])
def test_ball_joints_of_a_specification_can_be_locked(key):
    spec = mujoco.MjSpec.from_file(BOOM)
    run = simulate(spec, drive="crank", speed=1.0, turns=0.1, lock=dict.fromkeys(LOCKED), key=key)
    position = run.motion.points["tip"].position
    np.testing.assert_allclose(position[-1], tip(key, 0.2 * np.pi), atol=1e-13)
    with pytest.raises(InputError, match="--lock names 'neck', a ball joint"):
        simulate(spec, drive="crank", speed=1.0, lock={"neck": 0.1})


def test_locked_ball_joints_are_removed_from_tuned_models():
    driven = DriveOptions(lock=(("neck", None), ("loose", None)), drive=(("crank", "0.5*t"),))
    scene = user_scene(BOOM, driven, ControlOptions())
    assert (scene.model.nq, spec_of(scene).compile().nq) == (3, 3)
    text = tuned_text(scene, PlainSettings(), [], FOLDER).after
    assert "ball" not in text
    assert "freejoint" not in text
    model = mujoco.MjModel.from_xml_string(text)
    assert model.key("k").qpos.tolist() == [0.4, 0.05, 0.7]


def test_a_base_fixed_in_a_tuned_model_does_not_collide_with_its_children(tmp_path):
    """MuJoCo filters contacts of a body with its parent, unless the parent is fixed."""
    path = tmp_path / "base.xml"
    arm = '<body name="arm" pos="0.02 0 0"><joint name="crank"/><geom size="0.1"/></body>'
    base = f'<body name="base" pos="0 0 1"><freejoint/><geom size="0.1"/>{arm}</body>'
    path.write_text(f"<mujoco><worldbody>{base}</worldbody></mujoco>")
    scene = user_scene(str(path), DriveOptions(fix_base=True, drive=(("crank", "0.5*t"),)), ControlOptions())
    text = tuned_text(scene, PlainSettings(), [], tmp_path).after
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert (model.nv, data.ncon) == (1, 0)
    write_scene(scene, PlainSettings(), text, tmp_path / "tuned.xml")


def test_a_locked_ball_joint_connects_its_links_rigidly():
    path = str(FOLDER / "locked_ball_joints_arm.toml")
    solver = load(path, lock=["neck"])
    position = solver.positions([0.0, 1.2])["tip"]
    np.testing.assert_allclose(position[1], about_z(1.2) @ position[0], atol=1e-14)
    for method in ("pose", "step"):
        run = simulate(solver, speed=1.0, turns=0.25, method=method)
        assert run.outcome == "passed"
        np.testing.assert_allclose(run.motion.points["tip"].position[0], position[0], atol=1e-13)
        assert np.ptp(np.linalg.norm(run.motion.points["tip"].position, axis=1)) < 1e-9
    with pytest.raises(InputError, match="'neck' rotates about every axis, so that no single value locks it"):
        load(path, lock={"neck": "10deg"})
