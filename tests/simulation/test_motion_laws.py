"""Several drivers, slides and couplings under motion laws in MuJoCo: solved poses and time stepping."""

from dataclasses import replace

import numpy as np
import pytest
from driven_mechanisms import (
    boom,
    circle_intersection,
    five_bar,
    five_bar_with_cam,
    platform,
    press,
    rack_and_cam,
    sinusoidal,
    table,
)

import mechsim as ms
from mechsim.errors import MobilityError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.motion_laws import make_motion_laws, steady

ARMS = {"left": sinusoidal(2.0, 0.3, 6.0, 0.2), "right": sinusoidal(1.0, 0.4, 9.0, 1.0)}


def moved(mechanism, states, duration):
    return mechanism, make_motion_laws(mechanism, states, duration)


CASES = {
    "press": lambda: moved(press(), {"crank": sinusoidal(0.0, 9.0, 2.0)}, 1.0),
    "five-bar": lambda: moved(five_bar(), ARMS, 1.0),
    "boom": lambda: moved(boom(), {"stroke": sinusoidal(0.8, 0.1, 2.0)}, 3.0),
    "table": lambda: moved(table(backwards=False), {"tool": sinusoidal(0.0, 1.0, 3.0)}, 2.0),
    "table, backwards": lambda: moved(table(backwards=True), {"tool": sinusoidal(0.0, 1.0, 3.0)}, 2.0),
    "rack and cam": lambda: moved(rack_and_cam(), {"crank": sinusoidal(0.3, 1.0, 3.0)}, 2.0),
    "platform": lambda: platform()[:2],
}


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_solved_poses_satisfy_the_loop_equations(case):
    mechanism, moves = CASES[case]()
    run = ms.simulate(mechanism, motion_laws=moves)
    assert (run.method, run.outcome) == ("pose", "passed")
    verdict = ms.crosscheck(run, KinematicSolver(mechanism, motion_laws=moves))
    assert verdict.passed, verdict
    assert run.motion.drivers == mechanism.drivers
    for name, value in zip(moves.drivers, moves.state(run.motion.time)[0], strict=True):
        assert run.motion.joints[name].value == pytest.approx(value, abs=1e-14)


@pytest.mark.long
@pytest.mark.parametrize("case", CASES)
def test_stepped_states_satisfy_the_loop_equations(case):
    mechanism, moves = CASES[case]()
    run = ms.simulate(mechanism, motion_laws=moves, method="step")
    assert run.outcome == "passed"
    verdict = ms.crosscheck(run, KinematicSolver(mechanism, motion_laws=moves))
    assert verdict.passed, verdict
    # the driver is exact at the end of each step, with an error of second order in between
    for name, rate in zip(moves.drivers, moves.state(run.motion.time)[1], strict=True):
        assert run.motion.joints[name].rate == pytest.approx(rate, abs=1e-9)


def test_the_driver_error_is_of_second_order_in_the_step():
    mechanism, moves = CASES["five-bar"]()
    gaps = []
    for steps in (200, 400):
        motion = ms.simulate(mechanism, motion_laws=moves, settings=ms.Settings(steps_per_turn=steps)).motion
        gaps.append(np.abs(motion.joints["right"].value - moves.state(motion.time)[0][1]).max())
    assert 3.0 < gaps[0] / gaps[1] < 5.0


def test_a_tolerance_is_satisfied_at_the_driver_positions():
    mechanism, moves = CASES["five-bar"]()
    run = ms.simulate(mechanism, motion_laws=moves, tolerance=1e-8)
    joints = run.motion.joints
    exact = circle_intersection(joints["left"].value, joints["right"].value)
    assert run.outcome == "passed"
    assert np.abs(run.motion.points["P"].position[:, :2] - exact).max() < 1e-8


def test_coordinates_of_a_joint_are_recorded_separately():
    mechanism, moves = CASES["table"]()
    names = {name for name, _ in ms.simulate(mechanism, motion_laws=moves).motion.columns()}
    assert {"plane.q0", "plane.v1", "plane.a2", "tool.q"} <= names


def test_underdetermined_joints_are_reported_by_name():
    mechanism = replace(five_bar(), driver=("left",), guess_coordinates={})
    moves = make_motion_laws(mechanism, {"left": steady(2.0, 1.0)}, 0.01)
    with pytest.raises(MobilityError, match=r"underdetermined: with the drivers locked .*joint 'right'"):
        ms.simulate(mechanism, motion_laws=moves, method="pose")
    assert ms.simulate(mechanism, motion_laws=moves).method == "step"


@pytest.mark.long
def test_a_wrong_motion_law_fails_the_check_of_its_driver():
    mechanism, moves = CASES["five-bar"]()
    other = make_motion_laws(mechanism, ARMS | {"right": sinusoidal(1.0, 0.4, 9.0, 1.0 + 1e-9)}, 1.0)
    verdict = ms.crosscheck(
        ms.simulate(mechanism, motion_laws=moves), KinematicSolver(mechanism, motion_laws=other)
    )
    assert [check.title for check in verdict.checks if not check.passed] == ["drive: right"]


@pytest.mark.long
def test_a_wrong_dimension_fails_the_check():
    mechanism, moves = CASES["five-bar"]()
    joints = tuple(
        replace(joint, a=ms.End(GROUND, (0.1 + 1e-9, 0.0, 0.0))) if joint.name == "right" else joint
        for joint in mechanism.joints
    )
    run = ms.simulate(replace(mechanism, joints=joints), motion_laws=moves)
    assert not ms.crosscheck(run, KinematicSolver(mechanism, motion_laws=moves)).passed


def test_a_nonlinear_coupling_of_a_passive_joint_is_stepped():
    mechanism = five_bar_with_cam()
    moves = make_motion_laws(mechanism, ARMS, 1.0)
    run = ms.simulate(mechanism, motion_laws=moves, settings=ms.Settings(steps_per_turn=4000))
    assert run.outcome == "passed"
    joints = run.motion.joints
    law = 0.01 * joints["A"].value + 0.004 * joints["A"].value ** 2
    assert joints["cam"].value == pytest.approx(law, abs=2e-6)
