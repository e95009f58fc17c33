"""Coincident change points: coupled wheels in a row whose rods are all collinear at once."""

import numpy as np
import pytest
from mechanisms import on_one_crank
from wheel_linkages import START, assert_equal_rotation, wheel_linkages

import mechsim as ms
from mechsim.kinematics.loops.motion import driven_path
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.numerics.continuation import even_change_point

# positions, velocities and accelerations in radii, by polynomials about a change point. Measured
# 1e-12, 1e-9 and 1e-8 at most, growing with the number of wheels; another assembly mode differs by 0.1
BOUNDS = (2e-12, 2e-9, 2e-8)


@pytest.mark.parametrize("wheels", [2, 3, 4, 5])
def test_coupled_wheels_rotate_equally_through_coincident_change_points(wheels):
    mechanism = wheel_linkages(wheels)
    # the change points, poses close to them, and one and a half revolutions between them
    angle = np.r_[0.0, np.pi, np.pi + np.array([-1e-2, -1e-5, 1e-8, 3e-3]), np.arange(-1.0, 8.0, 0.173)]
    assert_equal_rotation(mechanism, ms.loops.solve(mechanism, angle, 3.0), BOUNDS)


@pytest.mark.parametrize("steps", [61, pytest.param(400, marks=pytest.mark.slow)])
def test_a_change_point_of_two_pairs_is_detected_for_any_step(steps):
    path = driven_path(wheel_linkages(3))
    for end in np.linspace(START, START + 2.0 * np.pi, steps):
        path.extend(end)
    assert sorted(path.change_points)[:2] == pytest.approx([np.pi, 2.0 * np.pi], abs=1e-10)


@pytest.mark.parametrize("wheels", [3, 4])
def test_coupled_wheels_have_a_period_of_one_revolution(wheels):
    solver = KinematicSolver(wheel_linkages(wheels))
    assert solver.crank_range().full
    assert solver.period == 2.0 * np.pi
    # cosines distinguish half and full revolutions independently of rounding
    assert sorted(np.cos(solver.change_points())) == pytest.approx([-1.0, 1.0], abs=1e-15)


def test_two_linkages_on_one_crank_have_a_period_of_two_revolutions():
    # each has one change point per revolution and continues in its other assembly mode
    item = ms.catalog.make("four_bar", ground=0.1, crank=0.04, coupler=0.12, rocker=0.06)
    other = ms.catalog.make("four_bar", ground=0.09, crank=0.03, coupler=0.11, rocker=0.05)
    solver = KinematicSolver(on_one_crank(item.mechanism, other.mechanism))
    assert len(solver.change_points()) == 1
    assert solver.period == KinematicSolver(item.mechanism).period == 4.0 * np.pi
    angle = np.r_[solver.change_points(), np.linspace(-1.0, 12.0, 60)]
    result = solver.solve(angle)
    for linkage in (item, other):
        exact = linkage.starting_at([linkage.mechanism.start]).solve(angle)
        position = result.points["B" if linkage is item else "B'"]
        np.testing.assert_allclose(position.position, exact.points["B"].position, atol=1e-12)
        np.testing.assert_allclose(position.velocity, exact.points["B"].velocity, atol=1e-10)


def test_nearly_coincident_change_points_are_rejected():
    separate = wheel_linkages(3, lag=0.3)
    angle = np.r_[np.pi, np.pi + 0.3, np.arange(0.0, 6.4, 0.1)]
    assert_equal_rotation(separate, ms.loops.solve(separate, angle, 3.0), BOUNDS)
    with pytest.raises(ms.AssemblyError, match=r"wheels: the pose at crank angle 3\.14\d* rad is too near"):
        ms.loops.solve(wheel_linkages(3, lag=1e-3), [np.pi])


@pytest.mark.parametrize("pairs", [2, 4])
@pytest.mark.parametrize("zero", [-0.93, -0.2, 0.4, 0.97])
def test_an_even_zero_of_the_determinant_is_detected(pairs, zero):
    nodes = np.cos(np.linspace(np.pi, 0.0, 9))
    others = np.exp(0.7 * nodes) * (1.3 + 0.2 * np.sin(2.0 * nodes))
    interval = even_change_point(pairs * np.log(np.abs(nodes - zero) * others))
    assert interval is not None
    assert nodes[interval] <= zero <= nodes[interval + 1]
    assert even_change_point(np.log((nodes - zero) ** 2 + 0.3) + pairs * np.log(others)) is None
