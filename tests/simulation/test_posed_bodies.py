"""Where bodies stand and how their points move, of one state or many and of designs, by hand."""

import math

import mujoco
import numpy as np
import pytest

from mechsim.simulation.state import PosedBodies, rotated

# an arm that turns about z, and on it a slider that moves across and up
MODEL = """
<mujoco>
  <worldbody>
    <body pos=".1 .2 .3"><joint name="turn" axis="0 0 1"/><geom size=".01"/>
      <body pos=".3 0 .1"><joint name="way" type="slide" axis="0 .6 .8"/><geom size=".01"/></body></body>
  </worldbody>
</mujoco>
"""
PIVOT, OUT, WAY = np.array([0.1, 0.2, 0.3]), np.array([0.3, 0.0, 0.1]), np.array([0.0, 0.6, 0.8])
POINT = np.array([0.02, -0.05, 0.07])
STATES = np.array([[0.4, 0.11], [-1.3, 0.02], [2.2, -0.07]])


def turned(angle):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def assert_posed(posed, states, pivots):
    places, rotations, gradient = posed.poses(states)
    pivots = np.broadcast_to(pivots, (len(states), 3))
    turns = np.array([turned(angle) for angle, _ in states])
    arms = turns @ (OUT + states[:, 1:] * WAY)[..., None]
    np.testing.assert_allclose(places[:, 1], pivots, rtol=0, atol=1e-15)
    np.testing.assert_allclose(places[:, 2], pivots + arms[..., 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(rotations[:, 1:], turns[:, None].repeat(2, 1), rtol=0, atol=1e-15)
    arms = arms[..., 0] + turns @ POINT
    linear, angular = gradient(2, pivots + arms)
    np.testing.assert_allclose(linear[..., 0], np.cross([0.0, 0.0, 1.0], arms), rtol=0, atol=1e-15)
    np.testing.assert_allclose(linear[..., 1], turns @ WAY, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(angular, [[[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]]] * len(states))


@pytest.mark.parametrize("n", [1, 3])
def test_bodies_stand_and_move_as_by_hand(n):
    model = mujoco.MjModel.from_xml_string(MODEL)
    posed = PosedBodies(model)
    assert_posed(posed, STATES[:n], PIVOT)
    assert model.opt.disableflags == 0


@pytest.mark.parametrize("n", [1, 3])
def test_designs_have_places_of_their_own(n):
    model = mujoco.MjModel.from_xml_string(MODEL)
    bodies = np.repeat(model.body_pos[None], n, 0)
    bodies[:, 1] += np.arange(1, n + 1)[:, None] * [0.01, -0.02, 0.03]
    assert_posed(PosedBodies(model, {"body_pos": bodies}), STATES[:n], bodies[:, 1])


def test_a_number_of_states_that_comes_back_finds_its_batch_again():
    posed = PosedBodies(mujoco.MjModel.from_xml_string(MODEL))
    for n in [*range(2, 13), 2, 12]:
        assert_posed(posed, np.tile(STATES, (4, 1))[:n], PIVOT)


def test_vectors_are_carried_by_the_bodies_they_are_fixed_in():
    rotations = np.array([turned(0.0), turned(math.pi / 2.0)])
    np.testing.assert_allclose(rotated(rotations, POINT), [POINT, [0.05, 0.02, 0.07]], atol=1e-17)
    each = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    np.testing.assert_allclose(rotated(rotations, each), [each[0], [-5.0, 4.0, 6.0]], atol=1e-15)
