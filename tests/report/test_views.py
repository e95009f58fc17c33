"""Data of interactive views: assembly modes, motion laws and several drivers, compared with the solvers."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.spatial.transform import Rotation

import mechsim as ms
from mechsim.kinematics.loops.start import start_poses
from mechsim.pictures.view.pose_grid import quaternions
from mechsim.report.views import hand_grids, mechanism_view, motion_law_grid

SPEED = ms.units.rpm(600)


def test_a_view_contains_every_distinct_assembly_mode():
    linkage = ms.catalog.make("rssr")
    view = mechanism_view(linkage, SPEED)
    assert [grid.name for grid in view.grids] == ["branch -1", "branch 1"]
    first_mode, second_mode = (grid.quaternion["rocker"] for grid in view.grids)
    assert not np.allclose(first_mode, second_mode, atol=1e-3)
    for grid in view.grids:
        assert grid.ghost is not None
        assert grid.ghost.by > 1e3


@pytest.mark.long
def test_a_swinging_crank_has_dead_centres():
    linkage = ms.catalog.make("four_bar", crank=0.09)
    first_mode, second_mode = mechanism_view(linkage, SPEED).grids
    slider = first_mode.slider
    dead = [landmark.value for landmark in slider.landmarks if landmark.kind == "dead"]
    assert len(dead) == 2
    assert not slider.ring
    np.testing.assert_allclose(sorted(dead), [slider.nodes[0], slider.nodes[-1]], atol=1e-5)
    # at a dead centre the assembly modes coincide
    turns = [grid.quaternion["rocker"] for grid in (first_mode, second_mode)]
    same = np.abs((turns[0] * turns[1]).sum(1))
    assert min(same[0], same[-1]) > 1.0 - 1e-4
    assert same[180] < 0.99


def test_views_under_motion_laws_cover_their_time():
    solver = ms.load("five_bar")
    grid = motion_law_grid(solver)
    slider = grid.slider
    assert (slider.name, slider.unit) == ("time", "s")
    time = np.array([0.3217])
    exact = solver.solve(t=time)
    for link, moved in exact.links.items():
        result = make_interp_spline(slider.nodes, grid.position[link])(time)
        np.testing.assert_allclose(result, moved.position, atol=1e-8)


def test_each_driver_is_moved_within_its_limits_as_far_as_the_loops_close():
    solver = ms.load("five_bar")
    left, right = hand_grids(solver, {"left": (1.9, 2.3)}, start_poses(solver.mechanism)[1])
    assert (left.name, right.name) == ("move left", "move right")
    assert (left.slider.nodes[0], left.slider.nodes[-1]) == pytest.approx((1.9, 2.3))
    # the others stay where the motion laws start
    start = solver.motion_laws.first
    assert left.slider.start == start["left"]
    laws = {"left": "2.03rad + 1e-6rad*t", "right": f"{start['right']!r}rad + 0*t"}
    solved = ms.load("five_bar", drive=laws).solve(t=[0.0]).points["P"].position[0]
    components = next(item for item in left.readouts if item.name == "P").components.values()
    result = make_interp_spline(left.slider.nodes, np.column_stack([*components]))(2.03)
    np.testing.assert_allclose(result, solved, atol=1e-8)


def test_quaternions_represent_their_rotations():
    turns = Rotation.from_quat(np.random.default_rng(5).normal(size=(200, 4))).as_matrix()
    half = Rotation.from_rotvec(np.pi * np.vstack([np.eye(3), [[0.6, 0.0, 0.8]]])).as_matrix()
    for rotations in (turns, half, turns.reshape(10, 20, 3, 3)):
        restored = Rotation.from_quat(quaternions(rotations).reshape(-1, 4), scalar_first=True).as_matrix()
        np.testing.assert_allclose(restored.reshape(rotations.shape), rotations, atol=1e-15)
