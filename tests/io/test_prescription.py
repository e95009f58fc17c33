"""Prescribed motions: drivers with motion laws, locked joints, tracked points and tables of poses."""

import numpy as np
import pytest
from model_files import FOLDER, model_text

import mechsim as ms
from mechsim.io.driver_positions import poses_of_table
from mechsim.io.readers import load
from mechsim.kinematics.solvers import KinematicSolver

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


LAW = {"crank": "0.3*sin(2*pi*t)"}
TIMES = np.linspace(0.0, 2.0, 9)
ANGLES = 0.3 * np.sin(2.0 * np.pi * TIMES)


@pytest.fixture(scope="module")
def swinging():
    """A four-bar whose crank swings by a motion law for 2 s, the fastest rate of which is 1.9 rad/s."""
    return ms.load("four_bar", drive=LAW, duration=2.0)


@pytest.fixture(scope="module")
def exact():
    """The points of the four-bar at the crank angles of the motion law, by its closed form."""
    rate = 0.6 * np.pi * np.cos(2.0 * np.pi * TIMES)
    return ms.catalog.make("four_bar").solve(ANGLES, rate, -((2.0 * np.pi) ** 2) * ANGLES)


def test_solve_accepts_times_in_seconds(swinging, exact):
    motion = swinging.solve(t=TIMES)
    np.testing.assert_array_equal(motion.time, TIMES)
    np.testing.assert_allclose(motion.joints["crank"].value, ANGLES, atol=1e-14)
    for rate in ("position", "velocity", "acceleration"):
        np.testing.assert_allclose(
            getattr(motion.points["B"], rate), getattr(exact.points["B"], rate), atol=1e-11
        )
    np.testing.assert_allclose(swinging.positions(t=TIMES)["B"], exact.points["B"].position, atol=1e-14)


@pytest.mark.parametrize("looped", [False, True])
def test_a_crank_of_constant_speed_accepts_times(looped):
    solver = ms.catalog.make("four_bar")
    solver = KinematicSolver(solver.mechanism) if looped else solver
    start = solver.mechanism.start
    motion = solver.solve(t=TIMES, speed=3.0)
    by_angle = solver.solve(start + 3.0 * TIMES, 3.0)
    np.testing.assert_array_equal(motion.time, TIMES)
    np.testing.assert_allclose(motion.points["B"].acceleration, by_angle.points["B"].acceleration, atol=1e-11)
    np.testing.assert_allclose(
        solver.positions(t=TIMES, speed=3.0)["B"], by_angle.points["B"].position, atol=1e-14
    )
    run = ms.simulate(solver, speed=3.0, samples=4)
    assert ms.crosscheck(run, solver.solve(t=run.motion.time, speed=3.0)).passed


def test_a_run_with_a_motion_law_is_compared_at_its_crank_angles(swinging):
    run = ms.simulate(swinging, samples=40)
    crank = ms.catalog.make("four_bar")
    assert ms.crosscheck(run, swinging).passed
    assert ms.crosscheck(run, crank).passed
    wrong = ms.catalog.make("four_bar", coupler=1.001 * crank.coupler)
    assert not ms.crosscheck(run, wrong).passed


def test_sweeps_measure_designs_at_times_of_motion_laws(tmp_path):
    # a boom lifted by a ram; its size, by which motion laws of slides are normalised, goes with `arm`
    path = FOLDER / "times_of_motion_laws_boom.toml"
    function = f"{tmp_path / 'fastest.py'}:fastest"
    (tmp_path / "fastest.py").write_text(
        "def fastest(motion):\n    return motion.points['tip'].velocity[:, 0].max()\n"
    )
    arms = [0.4, 0.6]
    table = ms.sweep(path, {"arm": arms}, ["at:0.5:tip.x", "at:500ms:tip.y"], samples=20)
    alone = ms.sweep(path, {"arm": arms}, ["max:tip.vx", function], samples=20)
    for i, arm in enumerate(arms):
        solver = ms.load(path, {"arm": arm})
        position = solver.positions(t=[0.5])["tip"][0]
        assert table["at:0.5:tip.x"].values[i] == pytest.approx(position[0], abs=1e-13)
        assert table["at:500ms:tip.y"].values[i] == pytest.approx(position[1], abs=1e-13)
        fastest = solver.solve(t=np.linspace(0.0, 2.0, 20)).points["tip"].velocity[:, 0].max()
        assert alone["max:tip.vx"].values[i] == pytest.approx(fastest, rel=1e-12)
        assert alone["fastest.py:fastest"].values[i] == pytest.approx(fastest, rel=1e-12)
