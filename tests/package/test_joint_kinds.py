"""Loop equations, MuJoCo models and pictures treat every joint kind consistently."""

import mujoco
import numpy as np
import pytest

import mechsim as ms
from mechsim.mechanism.joint_kinds import KINDS, displaced
from mechsim.mechanism.links import GROUND, IDENTITY
from mechsim.shapes.joints import DRAW, link_shapes
from mechsim.simulation.mjcf.compiling import compiled
from mechsim.simulation.mjcf.generator import generate
from mechsim.simulation.mjcf.joints import part_names

CROSS_ANGLE = 1.1
# coordinates of a joint in [m] and [rad]
VALUES = (0.13, -0.7, 0.4, -0.3, 0.6)


def arm_with(kind, reversed_sides):
    """Return a crank with a link on a joint of this kind; side a may be the distal one."""
    proximal = ms.End("arm", (0.3, -0.1, 0.2), (0.2, -0.4, 1.0))
    distal = ms.End("tip", (0.01, 0.05, -0.02), (1.0, 2.0, -2.0), (0.0, 1.0, 1.0))
    a, b = (distal, proximal) if reversed_sides else (proximal, distal)
    return ms.Mechanism(
        name="arm",
        links=(ms.Link("arm"), ms.Link("tip")),
        joints=(
            ms.Joint("crank", "revolute", ms.End(GROUND), ms.End("arm")),
            ms.Joint(
                "J",
                kind,
                a,
                b,
                cross_angle=CROSS_ANGLE if KINDS[kind].crossed else np.pi / 2,
                lead=0.01 if KINDS[kind].helical else 0.0,
                length=float(np.linalg.norm(VALUES[:3])) if KINDS[kind].rod else 0.0,
            ),
        ),
        driver="crank",
        points={},
    )


def poses_at(mechanism, values):
    """Return the poses of the links with the crank at zero and the joint at its coordinates."""
    joint = mechanism.joint("J")
    shift, rotation_matrix = displaced(KINDS[joint.kind], values, CROSS_ANGLE)
    if joint.a.link == "tip":
        shift, rotation_matrix = -rotation_matrix.T @ shift, rotation_matrix.T
    proximal, distal = (joint.a, joint.b) if joint.a.link == "arm" else (joint.b, joint.a)
    rotation = proximal.frame @ rotation_matrix @ distal.frame.T
    position = np.asarray(proximal.point) + proximal.frame @ shift - rotation @ np.asarray(distal.point)
    return {"arm": IDENTITY, "tip": ms.Pose(position, rotation)}


def values_of(kind, *sizes):
    return tuple(count for count, _ in zip(sizes, KINDS[kind].units, strict=False))


@pytest.mark.parametrize("reversed_sides", [False, True])
@pytest.mark.parametrize("kind", KINDS)
def test_loop_equations_constrain_the_fixed_directions_of_a_kind(kind, reversed_sides):
    mechanism = arm_with(kind, reversed_sides)
    values = values_of(kind, *VALUES)
    if KINDS[kind].helical:
        values = (mechanism.joint("J").lead * -0.7 / (2.0 * np.pi), -0.7)
    poses = poses_at(mechanism, values)
    poses = {name: ms.Pose(pose.position[None], pose.rotation[None]) for name, pose in poses.items()}
    rows = ms.loops.equations(mechanism, poses, 0.0)
    assert np.abs(rows.residual).max() <= 1e-15
    constrained = 6 - KINDS[kind].dof + KINDS[kind].helical + KINDS[kind].rod
    assert rows.residual.shape == (1, 5 + constrained + 1)
    assert np.linalg.matrix_rank(rows.jacobian[0]) == 6 + constrained


@pytest.mark.parametrize("reversed_sides", [False, True])
@pytest.mark.parametrize("kind", [name for name, kind in KINDS.items() if kind.units and not kind.ball])
def test_joint_coordinates_of_the_model_match_the_kind(kind, reversed_sides):
    mechanism = arm_with(kind, reversed_sides)
    first, second = values_of(kind, *VALUES), values_of(kind, -0.21, 0.5, 1.1, 0.7, -0.2)
    model = compiled(generate(mechanism, ms.Scene(level="pose"), poses_at(mechanism, first)))
    data = mujoco.MjData(model)
    addresses = [model.joint(name).qposadr[0] for name in part_names(mechanism, mechanism.joint("J"))]
    for values in (first, second):
        data.qpos[addresses] = values
        mujoco.mj_forward(model, data)
        expected = poses_at(mechanism, values)["tip"]
        assert np.abs(data.body("tip").xpos - expected.position).max() <= 1e-15
        assert np.abs(data.body("tip").xmat.reshape(3, 3) - expected.rotation).max() <= 2e-15


@pytest.mark.parametrize("kind", [name for name, kind in KINDS.items() if len(kind.slides) < 3])
def test_every_kind_has_a_drawing_of_its_joint(kind, monkeypatch):
    mechanism = arm_with(kind, False)
    drawn = link_shapes(mechanism)
    monkeypatch.setitem(DRAW, kind, lambda canvas, joint: None)
    without_joint = link_shapes(mechanism)
    assert sum(map(len, drawn.values())) > sum(map(len, without_joint.values()))
