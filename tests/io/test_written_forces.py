"""Forces, limits and motors of a TOML file are in the written file, with their values, or are named."""

import mujoco
import numpy as np
import pytest
from model_files import changed_model, copied, model_text

import mechsim as ms

FORCES = model_text("written_forces.toml")
LIMITS = "limits = { lower = -0.9, upper = 0.8 }"


@pytest.fixture(scope="module")
def written():
    limited = ("[joints.slide]", f"[joints.slide]\n{LIMITS}")
    return changed_model("slider_crank", limited, more=FORCES.replace('"P"', '"A"'))


@pytest.mark.parametrize(
    ("format", "missing"),
    [
        ("toml", ""),
        ("sdf", "SDF has no place for it: springs between points, loads, motors, controls, rotors"),
        (
            "usda",
            "USD has no place for it: springs between points, loads, motors, controls, rotors, "
            "constant friction",
        ),
    ],
)
def test_forces_return_or_are_named(format, missing, written, tmp_path):
    exact = ms.load(written, still=True)
    result = ms.export(written, tmp_path / f"m.{format}", format=format)
    assert result.left_out == (f"left out, because {missing}" if missing else "")
    read = ms.load(tmp_path / f"m.{format}", still=True)
    assert read.ranges["slide"] == pytest.approx(exact.ranges["slide"], rel=1e-15)
    (friction,), (spring,) = read.forces.friction, read.forces.joint_springs
    assert (friction.viscous, friction.coulomb) == (2.0, 0.0 if format == "usda" else 0.5)
    assert (spring.stiffness, spring.rest) == (3.0, 0.4)
    if format == "toml":
        assert read.forces.springs == exact.forces.springs
        assert read.forces.armature == exact.forces.armature
        (motor,), (before,) = read.forces.actuators, exact.forces.actuators
        assert (motor.gear, motor.gain, motor.force_range) == (before.gear, before.gain, before.force_range)


def test_mujoco_reads_the_forces_of_a_written_model(written):
    result = ms.export(written, scene="dynamics")
    assert result.left_out == "left out, because MJCF has no place for it: loads, controls"
    model = mujoco.MjModel.from_xml_string(result.text)
    slide = model.joint("slide")
    assert model.opt.gravity.tolist() == [0.0, 0.0, -9.81]
    assert slide.range.tolist() == [-0.9, 0.8]
    assert slide.limited[0]
    assert np.ravel(slide.damping)[0] == 2.0
    assert slide.frictionloss[0] == 0.5
    assert slide.armature[0] == 0.3
    assert (np.ravel(slide.stiffness)[0], model.qpos_spring[slide.qposadr[0]]) == (3.0, 0.4)
    assert (np.ravel(model.tendon_stiffness)[0], model.tendon_lengthspring[0].tolist()) == (7.0, [0.2, 0.2])
    motor = model.actuator("actuator m")
    assert (motor.gainprm[0], motor.gear[0], motor.forcerange.tolist()) == (4.0, 2.0, [-6.0, 5.0])
    kinematic = ms.export(written).left_out
    assert kinematic.startswith("left out, because the scene motion has no place for it: springs between")


def test_mujoco_reads_damping_and_friction_of_a_serial_twin(written):
    result = ms.export(written, format="urdf", independent={"crank": ("20deg", "80deg")})
    assert {"springs", "rotors", "tendons", "actuators"} <= {*result.twin.left_out}
    slide = mujoco.MjModel.from_xml_string(result.text).joint("slide")
    assert (np.ravel(slide.damping)[0], slide.frictionloss[0]) == (2.0, 0.5)
    assert slide.range.tolist() == [-0.9, 0.8]


def test_friction_and_limits_of_joints_with_several_axes_are_named():
    text = 'name = "tube"\n[links.rod]\n'
    text += "inertia = { mass = 2.0, centre = [0, 0, 0], moments = [1.0, 1.0, 1.0] }\n"
    text += '[joints.j]\nkind = "cylindrical"\na = { link = "ground" }\nb = { link = "rod" }\n'
    text += "limits = { way = { lower = -1.0, upper = 1.0 } }\n[forces]\nfriction.j = { viscous = 2.0 }\n"
    for format in ("sdf", "usda"):
        named = ms.export(copied(text), format=format).left_out
        assert named.endswith("has no place for it: friction about several axes, limits of j.way")


def test_constant_friction_that_mujoco_does_not_have_is_named():
    friction = "[forces]\nfriction.P2 = { coulomb = 0.1 }\nfriction.rocker = { coulomb = 0.1 }"
    path = changed_model("rssr", more=friction)
    for options in ({"style": "menagerie"}, {"scene": "dynamics"}):
        result = ms.export(path, **options)
        assert result.left_out == "left out, because MJCF has no place for it: constant friction in P2"
        model = mujoco.MjModel.from_xml_string(result.text)
        assert np.count_nonzero(model.dof_frictionloss) == 1
