"""Solved poses of coupled wheels in a row, with change points of several pairs of assembly modes."""

import numpy as np
import pytest
from wheel_linkages import assert_equal_rotation, wheel_linkages

from mechsim.simulation import simulate
from mechsim.simulation.poses import follow
from mechsim.simulation.source import from_source

# measured: 4e-14, 2e-12 and 1e-10 of a radius; with change points 0.3 rad apart 1e-12, 1e-11, 1e-10
BOUNDS = (1e-11, 1e-10, 3e-9)


@pytest.mark.parametrize(("wheels", "lag"), [(3, 0.0), (4, 0.0), (5, 0.0), (3, 0.3)])
def test_coupled_wheels_turn_equally_through_multiple_change_points(wheels, lag):
    mechanism = wheel_linkages(wheels, lag)
    run = simulate(mechanism, speed=3.0, turns=1, samples=72, method="pose")
    assert run.outcome == "passed"
    assert_equal_rotation(mechanism, run.motion, BOUNDS)


@pytest.mark.long
@pytest.mark.parametrize("wheels", [3, 4])
@pytest.mark.parametrize("samples", [17, 64, 73])
def test_change_points_are_found_for_any_number_of_samples(wheels, samples):
    closed = from_source(wheel_linkages(wheels))
    _, path = follow.follow_path(closed.loops, closed.qpos, np.linspace(0.2, 6.1, samples))
    passed = [point for point in path.change_points if 0.2 <= point <= 6.1]
    assert passed == pytest.approx([np.pi], abs=1e-9)
