"""MuJoCo's poses of coupled wheels in a row, where several pairs of assembly modes meet at once."""

import numpy as np
import pytest
from wheel_linkages import assert_all_turn_alike, wheel_linkages

from mechsim.simulation import loop_jacobian, simulate
from mechsim.simulation.poses import follow
from mechsim.simulation.source import from_source

# as measured: 4e-14, 2e-12 and 1e-10 of a radius; with rods that lie flat 0.3 rad apart 1e-12, 1e-11, 1e-10
BOUNDS = (1e-11, 1e-10, 3e-9)


@pytest.mark.parametrize(("wheels", "lag"), [(3, 0.0), (4, 0.0), (5, 0.0), (3, 0.3)])
def test_wheels_turn_alike_by_poses_where_all_rods_lie_flat(wheels, lag):
    mechanism = wheel_linkages(wheels, lag)
    run = simulate(mechanism, speed=3.0, turns=1, samples=72, method="pose")
    assert run.outcome == "passed"
    assert_all_turn_alike(mechanism, run.motion, BOUNDS)


@pytest.mark.parametrize("wheels", [3, 4])
@pytest.mark.parametrize("samples", [17, 64, 73])
def test_branch_points_are_known_however_many_poses_are_requested_for(wheels, samples):
    closed = from_source(wheel_linkages(wheels))
    _, path = follow.follow_path(closed.loops, closed.qpos, np.linspace(0.2, 6.1, samples))
    passed = [point for point in path.change_points if 0.2 <= point <= 6.1]
    assert passed == pytest.approx([np.pi], abs=1e-9)
    # one side from end to end, or another beyond: so each pose is known to lie on the path
    sides = loop_jacobian.determinant_sign(
        closed.loops, closed.loops.linearise(follow.follow(closed.loops, closed.qpos, [0.5, 4.0]))[1]
    )
    assert sides[0] * sides[1] == (-1.0) ** (wheels - 1)
