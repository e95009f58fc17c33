"""Motions of several drivers; laws/test_motion.py has their rates, and joints and couplings of every kind."""

from dataclasses import replace

import numpy as np
import pytest
from driven_mechanisms import five_bar
from model_files import stated_mechanism
from motions import largest_difference, started_at
from scipy.optimize import brentq

import mechsim as ms
from mechsim.errors import AssemblyError
from mechsim.kinematics.loops.mobility import with_component_locked
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion_laws import make_motion_laws, steady, tabled


def test_drivers_out_of_reach_are_rejected_with_the_time():
    mechanism = five_bar()
    states = {"left": steady(2.0, 1.0), "right": steady(1.0, -1.0)}
    solver = KinematicSolver(mechanism, motion_laws=make_motion_laws(mechanism, states, 3.0))

    def arms_apart(time):
        ends = [0.05 * np.exp(1j * (2.0 + time)), 0.1 + 0.05 * np.exp(1j * (1.0 - time))]
        return abs(ends[1] - ends[0]) - 0.18

    when = float(brentq(arms_apart, 0.1, 0.8))
    with pytest.raises(AssemblyError, match=rf"the drivers cannot pass {when:.6g}\d* s"):
        solver.solve(t=np.linspace(0.0, 3.0, 41))


def test_a_table_is_a_motion_law():
    time = np.linspace(0.0, 1.0, 41)
    value, rate, _ = tabled("left", time, 2.0 + 0.1 * time**3)(np.array([0.5]))
    assert (value[0], rate[0]) == pytest.approx((2.0 + 0.1 / 8, 0.3 / 4))


def test_a_gear_pair_determines_a_five_bar():
    pair = ms.Gear("left", "right", 1.0, phase=-1.0)
    motion = ms.loops.solve(replace(five_bar(), driver="left", start=2.0, gears=(pair,)), [2.0, 2.1])
    assert motion.joints["right"].rate == pytest.approx([1.0, 1.0])


def test_an_unobserved_ball_is_not_underdetermined():
    motion = ms.loops.solve(stated_mechanism("undetermined_joints_ball.toml"), [0.0, np.pi / 2])
    np.testing.assert_allclose(motion.points["P"].position[1], [0.0, 0.1, 0.0], atol=1e-16)


def test_a_start_at_a_dead_centre_is_not_underdetermined():
    linkage = ms.catalog.make("four_bar", rocker=0.035)
    ((_, high), *_) = linkage.crank_range().arcs
    mechanism = started_at(linkage.mechanism, linkage.solve([high - 1e-7]))
    result = ms.loops.solve(mechanism, [high - 0.1])
    assert result.spinning == frozenset()
    # the start is 1e-7 rad from the dead centre, where half the digits are lost; the requested pose is not
    off = largest_difference(result, linkage.solve([high - 0.1]), kind="links")
    assert off <= 1e-9 * mechanism.characteristic_length


def test_locking_a_coordinate_removes_one_dof():
    basis = np.linalg.qr(np.random.default_rng(3).standard_normal((9, 9)))[0][:5]
    locked = with_component_locked(basis, basis[:, 4])
    assert locked.shape == (4, 9)
    np.testing.assert_allclose(locked[:, 4], 0.0, atol=1e-15)
    np.testing.assert_allclose(locked @ locked.T, np.eye(4), atol=1e-14)
    assert np.linalg.matrix_rank(np.vstack([basis, locked]), tol=1e-12) == 5
