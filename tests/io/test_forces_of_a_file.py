"""The forces of a file act in every Python call that is given what `ms.load` returns."""

import mujoco
import numpy as np
import pytest
from model_files import FOLDER, changed_model, copied, load_model, model_text

import mechsim as ms
from mechsim.simulation.dynamics.prescribed_motion import driven

# a slider pushed along x by 500 N: the inertia of the links is negligible
PRESS = FOLDER / "forces_of_a_file_press.toml"
SPEED, ANGLES = 1.0, np.array([0.7, 1.5, 2.6])


def torque_by_virtual_power(angle):
    """Return the crank torque that holds 500 N on the slider, from the slider's rate by the crank angle."""
    sine, cosine = np.sin(angle), np.cos(angle)
    return -500.0 * (0.03 * sine + 0.03**2 * sine * cosine / np.sqrt(0.09**2 - (0.03 * sine) ** 2))


def inverse(solver, *forces):
    return ms.dynamics.prescribed(ms.dynamics.dynamic_model(solver, *forces), ANGLES, SPEED)


def simulated(solver, *forces):
    return driven(solver, *forces, speed=SPEED, samples=12)


@pytest.mark.parametrize("method", [inverse, simulated])
def test_forces_of_a_file_act_unless_others_are_stated(method):
    result, free = method(ms.load(PRESS)).forces, method(ms.load(PRESS), ms.Forces()).forces
    # the links' inertia at 1 rad/s takes less than 1e-5 N m
    np.testing.assert_allclose(result.torque, torque_by_virtual_power(result.angle), atol=1e-5)
    assert np.abs(free.torque).max() < 1e-5


def test_forces_of_a_file_act_in_sensitivities_sweeps_and_validation():
    solver = ms.load(PRESS)
    exact = torque_by_virtual_power(ANGLES)
    result = dict(ms.sensitivity(solver, "torque", "A.at.x", angles=ANGLES, speed=SPEED).values)
    np.testing.assert_allclose(result["torque"], exact, atol=1e-5)
    largest = ms.sweep(solver, {"A.at.x": [0.0]}, "at:1.5:torque", speed=SPEED)
    np.testing.assert_allclose(largest["at:1.5:torque"].values, exact[1], atol=1e-5)
    agrees = ms.validate(
        solver, lambda angle: {"torque:crank": torque_by_virtual_power(angle)}, speed=SPEED, tolerance=1e-4
    )
    assert agrees.passed, agrees


@pytest.mark.parametrize(
    ("rest", "is_questioned"), [("0.36", True), ("360", False), ("'0.36 mm'", False), ("0", False)]
)
def test_a_rest_length_that_fits_in_metres_only_is_questioned(rest, is_questioned):
    # a block on a slide has the size 1 m
    facts = load_model("forces_of_a_file_block.toml", rest=rest, still=True).facts
    assert any("'0.36 m'" in fact for fact in facts) == is_questioned


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
