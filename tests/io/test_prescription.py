"""Prescribed motions: drivers with motion laws, locked joints, tracked points and tables of poses."""

import numpy as np
from model_files import model_text

from mechsim.io.driver_positions import poses_of_table
from mechsim.io.readers import load

FIVE_BAR = model_text("prescription_five_bar.toml")


def two_circles(left, right, arm=0.05, rod=0.09, ground=0.1):
    """Return the upper intersection of two circles about the ends of the arms."""
    a = np.stack([arm * np.cos(left), arm * np.sin(left)], 1)
    d = np.stack([ground + arm * np.cos(right), arm * np.sin(right)], 1)
    half = (d - a) / 2.0
    length = np.linalg.norm(half, axis=1)[:, None]
    return a + half + np.sqrt(rod**2 - length**2) * np.stack([-half[:, 1], half[:, 0]], 1) / length


def test_floating_bases_are_fixed_at_their_initial_pose(file):
    text = model_text("prescription_text.toml")
    solver = load(file(text), fix_base=True)
    position = solver.positions([0.0, np.pi / 2])["hand"]
    across = np.array([0.0, np.cos(0.5), np.sin(0.5)])
    pivot = np.array([1.0, 2.0, 3.0]) + 0.2 * across
    np.testing.assert_allclose(position, [pivot + np.array([0.3, 0, 0]), pivot + 0.3 * across], atol=1e-14)


def test_a_table_of_poses_keeps_the_assembly_mode_of_the_guess(file):
    rng = np.random.default_rng(3)
    left, right = np.deg2rad(rng.uniform(80, 150, 40)), np.deg2rad(rng.uniform(30, 100, 40))
    left[7], right[7] = left[6], right[6]
    poses = poses_of_table(load(file(FIVE_BAR)), {"left": left, "right": right}, "rows.csv")
    columns = dict(poses.columns())
    joints = [f"{name}.q" for name in ("left", "right", "A", "D", "P")]
    assert list(columns) == ["left", "right", "P.x", "P.y", "P.z", *joints]
    expected = two_circles(left, right)
    np.testing.assert_allclose(np.stack([columns["P.x"], columns["P.y"]], 1), expected, atol=1e-13)
    assert len(poses_of_table(load(file(FIVE_BAR)), {"left": left[:1], "right": right[:1]}, "rows.csv")) == 1
