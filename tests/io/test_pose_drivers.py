"""Inverse kinematics of points and links by both methods agrees with separate formulas."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mechsim as ms
from mechsim.io.readers import load_by_motors

CIRCLE = {"P.x": "10mm*sin(2*pi*t)", "P.y": "100mm+10mm*cos(2*pi*t)"}
TIMES = np.linspace(0.0, 1.0, 21)
TILT = {
    "plate.x": "10mm*sin(2*pi*t)",
    "plate.y": "140mm",
    "plate.z": "5mm*sin(4*pi*t)",
    "plate.rx": "5deg*sin(2*pi*t)",
    "plate.ry": "0deg",
    "plate.rz": "10deg*sin(2*pi*t)",
}


def five_bar_angles(x, y):
    """Return the motor angles of the gallery's five-bar at tool positions, by two circles each."""
    half, arm, forearm = 0.03, 0.06, 0.08
    angles = []
    for side in (-1.0, 1.0):
        dx, dy = x - side * half, y
        distance = np.hypot(dx, dy)
        corner = np.arccos((arm**2 + distance**2 - forearm**2) / (2 * arm * distance))
        angles.append(np.arctan2(dy, dx) - side * corner)
    return angles


def test_motor_angles_for_a_point_path_agree_with_two_circles():
    motion = ms.load("five_bar", drive=CIRCLE).solve(t=TIMES)
    x, y = 0.01 * np.sin(2 * np.pi * TIMES), 0.1 + 0.01 * np.cos(2 * np.pi * TIMES)
    point = motion.points["P"]
    np.testing.assert_allclose(point.position, np.stack([x, y, 0 * x], 1), atol=1e-15)
    np.testing.assert_allclose(point.velocity[:, 0], 0.02 * np.pi * np.cos(2 * np.pi * TIMES), atol=1e-14)
    for name, angle in zip(("left", "right"), five_bar_angles(x, y), strict=True):
        np.testing.assert_allclose(motion.joints[name].value, angle, atol=1e-13)


def test_a_platform_has_the_prescribed_pose_and_leg_lengths():
    solver = ms.load("stewart_gough", drive=TILT)
    motion = solver.solve(t=TIMES)
    plate = motion.links["plate"]
    sine = np.sin(2 * np.pi * TIMES)
    angles = np.stack([np.radians(5) * sine, 0 * sine, np.radians(10) * sine], 1)
    expected = Rotation.from_euler("XYZ", angles).as_matrix()
    np.testing.assert_allclose(plate.rotation, expected, atol=1e-14)
    mechanism = ms.load("stewart_gough").mechanism

    def end(base, link):
        """Return the point of a base at which a joint connects a link."""
        joint = next(j for j in mechanism.joints if {j.a.link, j.b.link} == {base, link})
        return np.array((joint.a if joint.a.link == base else joint.b).point)

    for name in (f"l{number}" for number in range(1, 7)):
        leg = mechanism.joint(name)
        ends = plate.position + plate.rotation @ end("plate", leg.b.link) - end("ground", leg.a.link)
        np.testing.assert_allclose(motion.joints[name].value, np.linalg.norm(ends, axis=1), atol=1e-13)


@pytest.mark.long
def test_motors_and_pose_drivers_have_the_same_power():
    weight = ms.Forces(gravity=(0.0, -9.81, 0.0))
    pose_model = ms.dynamics.dynamic_model(ms.load("five_bar", drive=CIRCLE), weight)
    by_pose = ms.dynamics.prescribed(pose_model, t=TIMES)
    motors = load_by_motors("five_bar", drive=CIRCLE)
    assert motors.mechanism.drivers == ("left", "right")
    by_motors = ms.dynamics.prescribed(ms.dynamics.dynamic_model(motors, weight), t=TIMES)

    joints = ms.load("five_bar", drive=CIRCLE).solve(t=TIMES).joints

    def power(result, names):
        return sum(result.forces.drives[name] * joints[name].rate for name in names)

    expected = power(by_pose, ("P.x", "P.y"))
    assert np.abs(expected).max() > 1e-3
    # the chain weighs 1e-9 kg and moves at 0.06 m/s
    np.testing.assert_allclose(power(by_motors, ("left", "right")), expected, rtol=0, atol=2e-9)


def test_sites_and_bodies_of_an_mjcf_file_can_be_driven(tmp_path, mechsim):
    path = str(tmp_path / "five_bar.xml")
    mechsim("export", "five_bar", "--scene", "dynamics", "-o", path)
    motion = ms.load(path, drive=CIRCLE).solve(t=TIMES)
    expected = ms.load("five_bar", drive=CIRCLE).solve(t=TIMES)
    for name in ("left", "right"):
        np.testing.assert_allclose(motion.joints[name].rate, expected.joints[name].rate, atol=1e-11)
    assert not any(name.startswith("~") for name in motion.points)


def test_default_classes_of_a_file_do_not_affect_the_chain():
    limited = mujoco.MjSpec.from_string(
        """<mujoco><default><joint range="-40 40" limited="true" damping="3"/></default><worldbody>
        <body name="arm"><joint name="shoulder" axis="0 0 1"/><geom size=".01" pos=".1 0 0"/>
        <body name="hand" pos=".1 0 0" euler="0 0 20"><joint name="elbow" axis="0 0 1"/>
        <geom size=".01" pos=".1 0 0"/><site name="tip" pos=".1 0 0"/></body></body></worldbody></mujoco>"""
    )
    laws = {"tip.x": "0.19+0.003*sin(2*pi*t)", "tip.y": "0.03+0.01*t"}
    solver = ms.load(limited, drive=laws)
    assert set(solver.ranges) == {"shoulder", "elbow"}
    tip = solver.solve(t=TIMES).points["tip"].position
    np.testing.assert_allclose(tip[:, 0], 0.19 + 0.003 * np.sin(2 * np.pi * TIMES), atol=1e-14)
