"""An MJCF file read as a mechanism: poses and loops agree with MuJoCo's of the same file."""

import mujoco
import numpy as np
import pytest
from equalities import KINDS, text_with
from model_files import model_text

from mechsim.errors import InputError
from mechsim.mechanism.joints import joint_coordinate
from mechsim.mechanism.links import GROUND, IDENTITY, VIRTUAL_PREFIX
from mechsim.simulation.mjcf_reader.file_errors import MAX_DEPTH
from mechsim.simulation.mjcf_reader.kinematic_tree import kinematic_tree, poses
from mechsim.simulation.mjcf_reader.reading import read_model

# every kind of joint, several on one body, ref, points off the origin, jointless bodies, frames,
# defaults, degrees, and a body called as the frame is
TREE = model_text("mjcf_reader_tree.xml")


def random_state(model, seed):
    """Return coordinates over several turns, quaternions of unit length."""
    random = np.random.default_rng(seed)
    data = mujoco.MjData(model)
    mujoco.mj_integratePos(model, data.qpos, random.standard_normal(model.nv) * 4.0, 1.0)
    return data.qpos.copy()


@pytest.mark.parametrize("seed", range(3))
def test_link_poses_and_coordinates_agree_with_mujoco(file, seed):
    read = read_model(file(TREE))
    model = read.spec.compile()
    state, data = random_state(model, seed), mujoco.MjData(model)
    data.qpos[:] = state
    mujoco.mj_kinematics(model, data)
    link_poses = {GROUND: IDENTITY, **poses(model, kinematic_tree(model), state)}
    for name, pose in link_poses.items():
        if name == GROUND or name.startswith(VIRTUAL_PREFIX):
            continue
        body = data.body({"ground_body": "ground"}.get(name, name))
        np.testing.assert_allclose(pose.position, body.xpos, atol=1e-14)
        np.testing.assert_allclose(pose.rotation, body.xmat.reshape(3, 3), atol=1e-14)
    for name, (link, position) in read.mechanism.points.items():
        np.testing.assert_allclose(link_poses[link].point(position), data.site(name).xpos, atol=1e-14)
    for joint in read.mechanism.joints:
        if joint.coordinates != (joint.name,):
            continue
        (value,) = joint_coordinate(joint, link_poses[joint.a.link], link_poses[joint.b.link])
        difference = value - data.joint(joint.name).qpos[0]
        assert abs(difference - 2.0 * np.pi * np.round(difference / (2.0 * np.pi))) < 1e-14


WITHOUT_TORQUE = '<weld body1="b2" body2="f" torquescale="0" anchor=".02 .01 -.03"/>'


def residuals_of(mechanism, link_poses, values):
    """Return the residuals as MuJoCo defines them: points, small rotations, coordinates."""
    gaps = []
    for joint in mechanism.joints[5:]:
        a, b = link_poses[joint.a.link], link_poses[joint.b.link]
        gaps.append(np.linalg.norm(a.point(joint.a.point) - b.point(joint.b.point)))
        if joint.kind == "fixed":
            rotation = (a.rotation @ joint.a.frame).T @ b.rotation @ joint.b.frame
            gaps.append(np.arccos(np.clip((np.trace(rotation) - 1.0) / 2.0, -1.0, 1.0)))
    for law in mechanism.laws:
        left, right = (
            sum(w * values[n] for n, w in side.items()) for side in (law.left_terms, law.right_terms)
        )
        gaps.append(abs(left - law.zeros[0] - law.polynomial(np.array(right))[0]))
    return np.array(gaps)


@pytest.mark.parametrize("equality", [*KINDS.values(), WITHOUT_TORQUE], ids=[*KINDS, "weld without torque"])
def test_residuals_of_equalities_agree_with_mujoco(file, equality):
    read = read_model(file(text_with(equality)))
    model = read.spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = state = random_state(model, 5)
    mujoco.mj_fwdPosition(model, data)
    link_poses = {GROUND: IDENTITY, **poses(model, kinematic_tree(model), state)}
    values = {name: data.joint(name).qpos[0] for name in ("crank", "j", "s1")}
    result = residuals_of(read.mechanism, link_poses, values)
    rows = data.efc_pos[data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)]
    assert np.linalg.norm(rows[:3]) > 1e-3
    assert result[0] == pytest.approx(np.linalg.norm(rows[:3]), rel=1e-12)
    if len(rows) == 6 and len(result) == 2:  # MuJoCo measures a rotation by the sine of the half angle
        assert np.sin(result[1] / 2.0) == pytest.approx(np.linalg.norm(rows[3:]), rel=1e-7)


def test_a_fixed_base_has_the_pose_of_the_keyframe(file):
    keys = '<keyframe><key name="up" qpos="0 0 0 1 0 0 0 0 4 5 6 1 1 0 0 0.3"/></keyframe></mujoco>'
    text = TREE.replace("</mujoco>", keys).replace(
        '<body name="loose"', '<frame pos="3 1 2" euler="9 8 7"><body name="loose"'
    )
    text = text.replace(
        '<freejoint/><geom size="0.01"/></body>', '<freejoint/><geom size="0.01"/></body></frame>'
    )
    read = read_model(file(text), fix_base=True, key="up")
    model = read.spec.compile()
    assert model.nq == 9
    assert len(read.qpos) == 9
    np.testing.assert_allclose(model.body("loose").pos, [4.0, 5.0, 6.0], atol=1e-14)
    np.testing.assert_allclose(model.body("loose").quat, [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0], atol=1e-14)
    assert read.mechanism.guess_coordinates["crank"] == 0.3
    assert "loose" not in {link.name for link in read.mechanism.links}


def nested(depth: int) -> str:
    """Return a file with elements nested to this depth."""
    bodies = depth - 3
    text = '<body><joint/><geom size="1"/>' * bodies + "</body>" * bodies
    return f"<mujoco><worldbody>{text}</worldbody></mujoco>"


BAD = {
    "too deep": (
        nested(MAX_DEPTH + 1),
        f"nested more than {MAX_DEPTH} deep, .*<include> it in their place",
    ),
    "a tendon through sites": (
        text_with('<tendon tendon1="rope" tendon2="one"/>'),
        "tendon 'rope' runs through sites",
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_an_invalid_file_is_rejected_in_one_line(file, what, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text, fragment = BAD[what]
    with pytest.raises(InputError, match=fragment) as rejected:
        read_model(file(text))
    assert "\n" not in str(rejected.value)
    assert not (tmp_path / "MUJOCO_LOG.TXT").exists()


def test_the_maximum_depth_and_a_doctype_are_accepted(file):
    assert mujoco.MjSpec.from_string(nested(MAX_DEPTH)).worldbody.first_body()
    kind = '<?xml version="1.0"?>\n<!DOCTYPE mujoco [\n<!ELEMENT mujoco ANY>\n<!ENTITY b "a > b">\n] >\n'
    assert read_model(file(kind + TREE)).mechanism == read_model(file(TREE)).mechanism


@pytest.mark.parametrize(("high", "output"), [(1e-9, ""), (1e-14, "bounds no volume")])
def test_a_nearly_flat_mesh_is_read_without_qhull_messages(file, capfd, high, output):
    text = f"""<mujoco><asset><mesh name="flat" vertex="0 0 0  1 0 0  0 1 0  1 1 {high}" face="0 1 3  0 3 2"/>
    </asset><worldbody><body name="b"><joint name="crank"/><geom type="mesh" mesh="flat"/></body>
    </worldbody></mujoco>"""
    read = read_model(file(text))
    assert any(output in remark for remark in read.remarks) or not output
    assert capfd.readouterr() == ("", "")
