"""Motions evaluated from states: rates are derivatives, and a pendulum satisfies Newton's law."""

from dataclasses import replace

import mechanisms
import mujoco
import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.simulation import loop_jacobian
from mechsim.simulation.model_loops import read_loops
from mechsim.simulation.recording import CHUNK, States, add_sensors, evaluate
from mechsim.simulation.source import assembled

SPEED, ACCELERATION, STEP, MIDDLE = 1.3, -2.1, 2e-3, 4
# first derivative by eighth-order differences
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / STEP

# a four-bar with a free coupler constrained by points: two on the crank pin and one on the rocker pin
ROTATION = np.array([[2.0, -1.0, 2.0], [2.0, 2.0, -1.0], [-1.0, 2.0, 2.0]]) / 3.0
PIN, ON_PIN, ON_ROCKER = (
    " ".join(map(repr, (point @ ROTATION).tolist()))
    for point in np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.1], [0.2, 0.1, 0.05]])
)
FREE = model_text(
    "recorded_motion_free.xml",
    axes=" ".join(map(repr, ROTATION.T[:2].ravel().tolist())),
    pin=PIN,
    on_pin=ON_PIN,
    on_rocker=ON_ROCKER,
)
# joints that follow the crank by a polynomial, and one at a constant angle
CURVE = model_text("recorded_motion_curve.xml")
PENDULUM = model_text("recorded_motion_pendulum.xml")


def of_text(text, points=()):
    spec = mujoco.MjSpec.from_string(text)
    track = add_sensors(spec, tuple(points))
    return read_loops(spec.compile()), track


def of_mechanism(mechanism):
    spec = assembled(mechanism, ms.Scene())
    track = add_sensors(spec, tuple(mechanism.points))
    return read_loops(spec.compile()), track


CASES = {
    "free body": lambda: of_text(FREE, ["A"]),
    "curve": lambda: of_text(CURVE, ["P"]),
    "four_bar": lambda: of_mechanism(ms.catalog.make("four_bar").mechanism),
    "guided rssr": lambda: of_mechanism(ms.catalog.make("rssr", guide=True).mechanism),
    **{item.name: lambda item=item: of_mechanism(item) for item in mechanisms.everything()},
}


def along(loops):
    """Nine instants of an accelerating crank with closed positions and velocities."""
    time = STEP * (np.arange(9) - MIDDLE)
    start = loop_jacobian.close(loops, loops.model.qpos0[None])
    _, jacobian = loops.linearise(start)
    rotated = SPEED * time + 0.5 * ACCELERATION * time**2
    steps = rotated[:, None] * loop_jacobian.tangent(loops, jacobian)
    qpos = loop_jacobian.close(loops, loops.displaced(np.repeat(start, 9, 0), steps))
    _, jacobian = loops.linearise(qpos)
    qvel = loop_jacobian.tangent(loops, jacobian) * (SPEED + ACCELERATION * time)[:, None]
    return States(time, qpos, qvel, np.full(9, ACCELERATION))


def assert_near(result, expected, tolerance=1e-9):
    assert np.abs(result - expected).max() <= tolerance * max(1.0, np.abs(expected).max())


@pytest.mark.parametrize("case", CASES)
def test_rates_are_derivatives_of_positions(case):
    loops, track = CASES[case]()
    states = along(loops)
    motion = evaluate(loops, track, states, "pose")
    assert_near(motion.speed, SPEED + ACCELERATION * states.time)
    assert_near(motion.acceleration, states.crank_acceleration)
    assert motion.closure.max() < 1e-14
    assert motion.joints.keys() >= {loops.model.joint(loops.model.dof_jntid[loops.crank]).name}
    for item in (*motion.points.values(), *motion.links.values()):
        assert_near(item.velocity[MIDDLE], FIRST @ item.position)
        assert_near(item.acceleration[MIDDLE], FIRST @ item.velocity)
    for link in motion.links.values():
        rate_of_rotation = np.tensordot(FIRST, link.rotation, 1) @ link.rotation[MIDDLE].T
        assert_near(link.angular_velocity[MIDDLE], rate_of_rotation[[2, 0, 1], [1, 2, 0]])
        assert_near(link.angular_acceleration[MIDDLE], FIRST @ link.angular_velocity)
    for joint in motion.joints.values():
        assert_near(joint.rate[MIDDLE], FIRST @ joint.value)
        assert_near(joint.acceleration[MIDDLE], FIRST @ joint.rate)


def test_coupled_joints_are_measured_from_the_model_reference():
    loops, track = CASES["curve"]()
    joints = evaluate(loops, track, replace(along(loops), crank_acceleration=None), "pose").joints
    assert [joints[name].unit for name in ("crank", "curve", "slide")] == ["rad", "rad", "m"]
    rotated = joints["crank"].value - np.deg2rad(20.0)
    curve = 0.1 + 0.5 * rotated + 0.3 * rotated**2 - 0.2 * rotated**3 + 0.1 * rotated**4
    assert_near(joints["curve"].value, np.deg2rad(10.0) + curve, 1e-14)
    assert_near(joints["slide"].value, 0.2 * rotated - 0.1 * rotated**2, 1e-14)
    assert_near(joints["still"].value, np.deg2rad(30.0) + 0.4, 1e-14)


@pytest.mark.parametrize("weightless", [False, True])
def test_a_pendulum_satisfies_newtons_law(weightless):
    loops, track = of_text(PENDULUM, ["tip"])
    if weightless:
        loops.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)
    n = CHUNK + 5
    time = np.linspace(0.0, 1.0, n)
    angle, speed, torque = np.sin(7.0 * time), 3.0 * np.cos(5.0 * time), 4.0 * np.cos(3.0 * time)
    states = States(time, angle[:, None], speed[:, None], force=torque)
    motion = evaluate(loops, track, states, "step")
    weight = 0.0 if weightless else 2.0 * 9.81 * 0.3 * np.cos(angle)
    expected = (torque - weight) / (0.01 + 1e-3 + 2.0 * 0.3**2)
    assert_near(motion.acceleration, expected)
    assert len(motion) == n
    along_arm = np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], 1)
    across = np.stack([-np.sin(angle), np.cos(angle), 0.0 * angle], 1)
    tip = motion.points["tip"]
    assert_near(tip.position, 0.5 * along_arm)
    assert_near(tip.velocity, 0.5 * speed[:, None] * across)
    assert_near(tip.acceleration, 0.5 * (expected[:, None] * across - speed[:, None] ** 2 * along_arm))
    assert_near(motion.links["arm"].acceleration, 0.0)
    assert track.links == ("arm", "body2")
    assert motion.closure.tolist() == [0.0] * n
