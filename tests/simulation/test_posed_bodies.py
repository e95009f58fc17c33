"""Poses of bodies and velocities of their points, against manual formulas."""

import math

import mujoco
import numpy as np
import pytest
from model_files import model_text
from wheel_linkages import about_z

from mechsim.simulation.state import PosedBodies, rotated

# an arm that turns about z, with a slider that moves sideways and up
MODEL = model_text("posed_bodies_model.xml")
PIVOT, OFFSET, DIRECTION = np.array([0.1, 0.2, 0.3]), np.array([0.3, 0.0, 0.1]), np.array([0.0, 0.6, 0.8])
POINT = np.array([0.02, -0.05, 0.07])
STATES = np.array([[0.4, 0.11], [-1.3, 0.02], [2.2, -0.07]])


def assert_posed(posed, states, pivots):
    positions, rotations, gradient = posed.poses(states)
    pivots = np.broadcast_to(pivots, (len(states), 3))
    turns = np.array([about_z(angle) for angle, _ in states])
    arms = turns @ (OFFSET + states[:, 1:] * DIRECTION)[..., None]
    np.testing.assert_allclose(positions[:, 1], pivots, rtol=0, atol=1e-15)
    np.testing.assert_allclose(positions[:, 2], pivots + arms[..., 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(rotations[:, 1:], turns[:, None].repeat(2, 1), rtol=0, atol=1e-15)
    arms = arms[..., 0] + turns @ POINT
    linear, angular = gradient(2, pivots + arms)
    np.testing.assert_allclose(linear[..., 0], np.cross([0.0, 0.0, 1.0], arms), rtol=0, atol=1e-15)
    np.testing.assert_allclose(linear[..., 1], turns @ DIRECTION, rtol=0, atol=1e-15)
    np.testing.assert_array_equal(angular, [[[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]]] * len(states))


@pytest.mark.parametrize("n", [1, 3])
def test_poses_and_jacobians_equal_manual_formulas(n):
    model = mujoco.MjModel.from_xml_string(MODEL)
    posed = PosedBodies(model)
    assert_posed(posed, STATES[:n], PIVOT)
    assert model.opt.disableflags == 0


def test_vectors_rotate_with_their_bodies():
    rotations = np.array([about_z(0.0), about_z(math.pi / 2.0)])
    np.testing.assert_allclose(rotated(rotations, POINT), [POINT, [0.05, 0.02, 0.07]], atol=1e-17)
    each = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    np.testing.assert_allclose(rotated(rotations, each), [each[0], [-5.0, 4.0, 6.0]], atol=1e-15)
