"""Loops of a model with free bodies connected by points: six DOFs and seven coordinates per body."""

import mujoco
import numpy as np
import pytest
from model_files import copied, model_text

from mechsim.io.readers import load
from mechsim.simulation import loop_jacobian
from mechsim.simulation.dynamics.forward_run import stepped_run
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.model_loops import read_loops
from mechsim.simulation.state import hinge_entries, quaternion_addresses, quaternion_entries

MODEL = model_text("free_bodies_model.xml")
DISTANCE = 0.1


@pytest.fixture
def loops():
    return read_loops(mujoco.MjModel.from_xml_string(MODEL.format(far=DISTANCE, crank=0.01)))


def states(loops, n=4, reach=0.3):
    steps = reach * np.random.default_rng(4).normal(size=(n, loops.model.nv))
    return loops.displaced(np.repeat(loops.model.qpos0[None], n, 0), steps)


def test_state_entries_are_classified_by_kind(loops):
    # crank, free body (position, quaternion), ball (quaternion), slide
    assert quaternion_addresses(loops.model) == [4, 8]
    assert quaternion_entries(loops.model).tolist() == [False] * 4 + [True] * 8 + [False]
    assert hinge_entries(loops.model).tolist() == [True] + [False] * 12
    assert loops.free.tolist() == [1, 2, 3, 4, 5, 6, 7, 8, 9, 10]
    assert (loops.crank, loops.crank_address) == (0, 0)


@pytest.mark.parametrize("n", [1, 4])
def test_displacements_agree_with_mujoco(loops, n):
    before = states(loops, n)
    steps = np.random.default_rng(5).normal(size=(n, loops.model.nv))
    # a rotation too small for a quotient, and one of more than a full turn
    steps[0, 4:7], steps[-1, 7:10] = (1e-9, -2e-9, 0.5e-9), (5.0, -4.0, 3.0)
    for state, step, moved in zip(before, steps, loops.displaced(before, steps), strict=True):
        expected = state.copy()
        mujoco.mj_integratePos(loops.model, expected, step, 1.0)
        assert np.abs(moved - expected).max() < 2e-15
    assert np.array_equal(before, states(loops, n))


def test_newton_steps_are_limited_to_half_a_radian_of_rotation(loops):
    before = states(loops)
    before[:, 1:4] += 10.0
    residual, jacobian = loops.linearise(before)
    full_steps = loop_jacobian.solve(loops, jacobian, -residual[..., None])[..., 0]
    step = loop_jacobian.newton_step(loops, residual, jacobian)
    turns = np.abs(full_steps[:, 3:9]).max(1, keepdims=True)
    assert turns.max() > 0.5
    np.testing.assert_allclose(step[:, loops.free], full_steps * np.minimum(1.0, 0.5 / turns))
    assert np.abs(step[:, 1:4]).max() > 0.5
    assert (step[:, 0] == 0.0).all()
    # a translation of any length is corrected in a single step
    shifted = np.repeat(loops.model.qpos0[None], 2, 0)
    shifted[:, 1:4] += 1e-3
    moved = loops.displaced(shifted, loop_jacobian.newton_step(loops, *loops.linearise(shifted)))
    assert loops.closure_error(loops.residual(moved)).max() < 1e-4


def test_solve_returns_the_minimum_norm_step(loops):
    _, jacobian = loops.linearise(states(loops))
    right = np.random.default_rng(1).normal(size=(4, jacobian.shape[1], 2))
    exact = np.linalg.pinv(jacobian[:, :, loops.free]) @ right
    np.testing.assert_allclose(loop_jacobian.solve(loops, jacobian, right), exact, rtol=1e-6, atol=1e-12)


def test_the_characteristic_length_is_the_longest_arm_or_body_distance(loops):
    reach = max(np.linalg.norm(local) for pair in loops.pairs for local in pair.local)
    assert loops.characteristic_length == max(reach, np.linalg.norm([0.3, 0.1, 0.0]))
    out = read_loops(mujoco.MjModel.from_xml_string(MODEL.format(far=DISTANCE, crank=9.0)))
    assert out.characteristic_length == pytest.approx(np.hypot(9.0, 0.02))
    distant = read_loops(mujoco.MjModel.from_xml_string(MODEL.format(far=7.0, crank=0.01)))
    assert distant.characteristic_length == pytest.approx(np.hypot(7.0, 0.03))
    assert distant.closure_error(
        np.array([[7.0, 0.0, 0.0, 0.0, -14.0, 0.0, 0.0, 0.0, 0.0]])
    ) == pytest.approx(14.0 / distant.characteristic_length)


LINKS = model_text("floating_links_links.xml")
ROD = '<body name="rod" pos="{x} 0 0">{joint}<geom fromto="0 0 0 0.08 0 0.06" mass="0.3"/></body>'
HINGED = {"rod": "", "hinged": ROD.format(x=0.03, joint='<joint axis="0 1 0"/>'), "loops": ""}
# two points of its pin constrain it as a hinge does
FLOATING = {
    "rod": ROD.format(x=0.03, joint='<freejoint name="float"/>'),
    "hinged": "",
    "loops": '<connect body1="crank" body2="rod" anchor="0.03 0.01 0"/>'
    '<connect body1="crank" body2="rod" anchor="0.03 -0.02 0"/>',
}


def read(joints, extra=""):
    return load(copied(LINKS.format(**joints, extra=extra), ".xml"), drive={"crank": "0.4*sin(2*pi*t)"})


@pytest.mark.parametrize("method", ["pose", "step"])
def test_a_floating_rod_gives_the_crank_torque_of_a_hinged_one(method):
    torque = [driven(read(item), samples=12, method=method).forces.torque for item in (HINGED, FLOATING)]
    assert np.ptp(torque[0]) > 0.05
    np.testing.assert_allclose(torque[1], torque[0], atol=1e-6 if method == "step" else 1e-12)


def test_an_unconstrained_floating_link_falls_in_mujoco():
    ball = '<body name="ball" pos="0 0 1"><freejoint name="loose"/><geom type="sphere" size="0.01"/></body>'
    solver = read(HINGED, extra=ball)
    times = np.linspace(0.0, 0.5, 11)
    run = stepped_run(solver.mechanism, solver.forces, {}, {"loose.x": 2.0}, times, 20)
    assert np.allclose(run.motion.joints["loose.x"].value, 2.0 * times, atol=1e-12)
    assert np.allclose(run.motion.joints["loose.z"].value, 1.0 - 0.5 * 9.81 * times**2, atol=1e-12)
