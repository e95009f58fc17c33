"""The loop equations report undetermined joints and assume no motion for them."""

from dataclasses import replace

import numpy as np
import pytest
from driven_mechanisms import five_bar
from model_files import stated_mechanism
from motions import largest_difference, started_at

import mechsim as ms
from mechsim.errors import MobilityError
from mechsim.kinematics.loops.mobility import with_component_locked


def test_a_five_bar_with_one_driver_is_rejected():
    with pytest.raises(MobilityError, match=r"underdetermined: .* right can still move") as error:
        ms.loops.solve(replace(five_bar(), driver="left", start=2.0), [2.0, 2.1])
    assert error.value.outcome == "underdetermined"


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
