"""Residuals and Jacobians of every kind of equality agree with MuJoCo's own constraints."""

import mujoco
import numpy as np
import pytest
from equalities import KINDS, text_with

from mechsim.simulation import loop_jacobian, recording
from mechsim.simulation.equality_rows import CouplingConstraint, Sum, chained
from mechsim.simulation.model_loops import read_loops
from mechsim.simulation.state import has_dry_friction


def model_of(equality):
    spec = mujoco.MjSpec.from_string(text_with(equality))
    track = recording.add_sensors(spec, ("s", "t"))
    return spec.compile(), track


def states_near(model, n, reach):
    rng = np.random.default_rng(3)
    states = np.repeat(model.qpos0[None], n, 0)
    for state in states:
        mujoco.mj_integratePos(model, state, reach * rng.normal(size=model.nv), 1.0)
    return states


@pytest.mark.parametrize("kind", KINDS)
def test_residual_and_jacobian_agree_with_mujoco(kind):
    model, _ = model_of(KINDS[kind])
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    loops, data = read_loops(model), mujoco.MjData(model)
    rotation_rows = loops.frame_rows
    for state in states_near(model, 3, 0.1):
        data.qpos[:] = state
        mujoco.mj_forward(model, data)
        position, gradient = data.efc_pos.copy(), data.efc_J.reshape(data.nefc, model.nv).copy()
        # MuJoCo uses the vector part of the quaternion; twice that is an angle
        position[rotation_rows] *= 2.0
        gradient[rotation_rows] *= 2.0
        for states in (state[None], np.stack([state] * 2)):
            residual, jacobian = loops.linearise(states)
            assert np.abs(residual - position).max() < 1e-15
            assert np.abs(jacobian - gradient).max() < 4e-15


@pytest.mark.parametrize("kind", KINDS)
def test_closure_acceleration_is_the_second_derivative_of_the_residual(kind):
    model, track = model_of(KINDS[kind])
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    loops = read_loops(model)
    qpos = loop_jacobian.close(loops, model.qpos0[None])
    rates = loop_jacobian.tangent(loops, loops.linearise(qpos)[1])
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos[0], rates[0]
    mujoco.mj_forward(model, data)
    fields = {name: getattr(data, name)[None] for name in ("xpos", "xmat", "sensordata", "qacc")}
    links = recording.link_motions(model, track, fields)
    result = recording.closure_acceleration(
        loops, recording.States(np.zeros(1), qpos, rates), data.qacc[None], links
    )[0]
    step = 2e-3
    time = step * np.arange(-4, 5)[:, None]
    path = loops.displaced(np.repeat(qpos, 9, 0), rates * time + 0.5 * data.qacc * time**2)
    second = np.array([-9, 128, -1008, 8064, -14350, 8064, -1008, 128, -9]) / 5040.0 / step**2
    # eighth-order differences: rounding over the square of the step
    assert np.abs(second @ loops.residual(path) - result).max() < 1e-9


@pytest.mark.parametrize(("coefficients", "bends"), [([0.3, -2.0, 0.5], True), ([0.3, -2.0, 0.0], False)])
def test_a_quadratic_coupling_is_nonlinear(coefficients, bends):
    side = Sum(np.array([0]), np.array([0]), np.zeros(1), np.ones(1))
    coupled = CouplingConstraint(side, side, np.array(coefficients), 0)
    assert coupled.nonlinear == bends
    value, gradient, _ = coupled.values(np.array([0.7]))
    assert value == pytest.approx(np.polynomial.polynomial.polyval(0.7, coefficients))
    assert gradient == pytest.approx(coefficients[1] + 2.0 * 0.7 * coefficients[2])
    assert not CouplingConstraint(side, None, np.array(coefficients), 0).nonlinear


@pytest.mark.parametrize("element", ["", "<joint ", "<fixed "])
def test_dry_friction_of_joints_and_tendons_is_detected(element):
    text = text_with("").replace(element, element + 'frictionloss=".1" ' * bool(element), 1)
    assert has_dry_friction(mujoco.MjModel.from_xml_string(text)) == bool(element)


def test_couplings_are_ordered_from_the_driven_coordinate():
    sides = [
        Sum(np.array([i]), np.array([i]), zeros=np.array([0.0]), weights=np.array([1.0])) for i in range(3)
    ]
    last, first = (CouplingConstraint(sides[i], sides[i - 1], np.array([0.0, 2.0, 1.0]), i) for i in (2, 1))
    assert [item.equality for item in chained([last, first], [0])] == [1, 2]
