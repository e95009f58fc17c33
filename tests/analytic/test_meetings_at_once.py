"""Assemblies that meet several pairs at once: coupled wheels in a row, whose rods all lie flat together."""

import numpy as np
import pytest
from coupled_wheels import START, assert_all_turn_alike, coupled_wheels

from mechsim.analytic import closure
from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.analytic.closure.meeting_cells import touched
from mechsim.analytic.closure.whole_motion import followed
from mechsim.errors import AssemblyError

# places, velocities and accelerations, in radii: about a change point they are read off polynomials. Measured
# 1e-12, 1e-9 and 1e-8 at the most, the more the more wheels; another assembly is off by 0.1
BOUNDS = (2e-12, 2e-9, 2e-8)


@pytest.mark.parametrize("wheels", [2, 3, 4, 5])
def test_wheels_turn_alike_where_all_rods_lie_flat(wheels):
    mechanism = coupled_wheels(wheels)
    # the change points themselves, poses close by, and a turn and a half in steps that fall between
    angle = np.r_[0.0, np.pi, np.pi + np.array([-1e-2, -1e-5, 1e-8, 3e-3]), np.arange(-1.0, 8.0, 0.173)]
    assert_all_turn_alike(mechanism, closure.solve(mechanism, angle, 3.0), BOUNDS)


@pytest.mark.parametrize("steps", [61, 400])
def test_a_change_point_of_two_pairs_is_found_however_it_is_come_upon(steps):
    path = followed(coupled_wheels(3))
    for end in np.linspace(START, START + 2.0 * np.pi, steps):
        path.extend(end)
    assert sorted(path.meetings)[:2] == pytest.approx([np.pi, 2.0 * np.pi], abs=1e-10)


@pytest.mark.parametrize("wheels", [3, 4])
def test_coupled_wheels_stand_as_before_after_one_turn_and_tell_their_change_points(wheels):
    form = LoopForm(coupled_wheels(wheels))
    assert form.crank_range().full
    assert form.period == 2.0 * np.pi
    # the signs tell a turn's half from its whole, wherever rounding puts the first
    assert sorted(np.cos(form.change_points())) == pytest.approx([-1.0, 1.0], abs=1e-15)


def test_rods_that_lie_flat_apart_are_passed_one_by_one_and_close_together_are_refused():
    apart = coupled_wheels(3, lag=0.3)
    angle = np.r_[np.pi, np.pi + 0.3, np.arange(0.0, 6.4, 0.1)]
    assert_all_turn_alike(apart, closure.solve(apart, angle, 3.0), BOUNDS)
    with pytest.raises(AssemblyError, match=r"wheels: the pose at crank angle 3\.14\d* rad is too near"):
        closure.solve(coupled_wheels(3, lag=1e-3), [np.pi])


@pytest.mark.parametrize("pairs", [2, 4])
@pytest.mark.parametrize("at", [-0.93, -0.2, 0.4, 0.97])
def test_a_determinant_that_touches_nought_is_told_from_one_that_stays_away(pairs, at):
    nodes = np.cos(np.linspace(np.pi, 0.0, 9))
    beside = np.exp(0.7 * nodes) * (1.3 + 0.2 * np.sin(2.0 * nodes))
    behind = touched(pairs * np.log(np.abs(nodes - at) * beside))
    assert behind is not None
    assert nodes[behind] <= at <= nodes[behind + 1]
    assert touched(np.log((nodes - at) ** 2 + 0.3) + pairs * np.log(beside)) is None
