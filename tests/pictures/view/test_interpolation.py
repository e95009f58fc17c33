import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from slider_interpolation import interpolated

from mechsim.pictures.view.pose_grid import Slider, quaternions

RANDOM = np.random.default_rng(5)


def slider(nodes, ring=False):
    return Slider("crank", "rad", np.asarray(nodes, dtype=float), ring, float(nodes[0]))


def test_quaternions_represent_their_rotations():
    turns = Rotation.from_quat(RANDOM.normal(size=(200, 4)))
    half = Rotation.from_rotvec(np.pi * np.vstack([np.eye(3), [[0.6, 0.0, 0.8]]]))
    for rotations in (turns, half):
        result = quaternions(rotations.as_matrix())
        restored = Rotation.from_quat(result, scalar_first=True).as_matrix()
        np.testing.assert_allclose(restored, rotations.as_matrix(), atol=1e-15)
    shaped = quaternions(turns.as_matrix().reshape(10, 20, 3, 3))
    assert shaped.shape == (10, 20, 4)


def test_cubic_interpolation_is_exact_for_cubics():
    own = slider([0.0, 0.3, 1.0, 1.4, 2.0])
    values = np.stack([own.nodes**3 - 2.0 * own.nodes, own.nodes**2 + 1.0], -1)
    for a in RANDOM.uniform(0.0, 2.0, 20):
        np.testing.assert_allclose(interpolated(own, values, a), [a**3 - 2.0 * a, a**2 + 1.0], atol=1e-13)


def ring_error(count):
    nodes = np.linspace(0.0, 2.0 * np.pi, count + 1)
    values = np.stack([np.cos(nodes), np.sin(nodes)], -1)
    middles = nodes[:-1] + np.pi / count
    result = np.array([interpolated(slider(nodes, ring=True), values, node) for node in middles])
    return np.abs(result - np.stack([np.cos(middles), np.sin(middles)], -1)).max()


def test_periodic_interpolation_has_fourth_order_across_the_seam():
    assert 3.8 < np.log2(ring_error(24) / ring_error(48)) < 4.2
    assert ring_error(360) == pytest.approx(3.0 / 128.0 * np.deg2rad(1.0) ** 4, rel=0.1)
