"""Several drivers, slides and couplings under motion laws in MuJoCo: solved poses and time stepping."""

import numpy as np
import pytest
from driven_mechanisms import (
    boom,
    circle_intersection,
    five_bar,
    five_bar_with_cam,
    press,
    rack_and_cam,
    sinusoidal,
    table,
)

import mechsim as ms
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion_laws import make_motion_laws

ARMS = {"left": sinusoidal(2.0, 0.3, 6.0, 0.2), "right": sinusoidal(1.0, 0.4, 9.0, 1.0)}


PLATFORM = ms.load("stewart_gough")


def moved(mechanism, states, duration):
    return mechanism, make_motion_laws(mechanism, states, duration)


CASES = {
    "press": lambda: moved(press(), {"crank": sinusoidal(0.0, 9.0, 2.0)}, 1.0),
    "five-bar": lambda: moved(five_bar(), ARMS, 1.0),
    "boom": lambda: moved(boom(), {"stroke": sinusoidal(0.8, 0.1, 2.0)}, 3.0),
    "table": lambda: moved(table(backwards=False), {"tool": sinusoidal(0.0, 1.0, 3.0)}, 2.0),
    "table, backwards": lambda: moved(table(backwards=True), {"tool": sinusoidal(0.0, 1.0, 3.0)}, 2.0),
    "rack and cam": lambda: moved(rack_and_cam(), {"crank": sinusoidal(0.3, 1.0, 3.0)}, 2.0),
    "platform": lambda: (PLATFORM.mechanism, PLATFORM.motion_laws),
}


@pytest.mark.long
@pytest.mark.parametrize("method", ["pose", "step"])
@pytest.mark.parametrize("case", CASES)
def test_states_satisfy_the_loop_equations_and_the_laws_of_the_drivers(case, method):
    mechanism, moves = CASES[case]()
    run = ms.simulate(mechanism, motion_laws=moves, method=method)
    assert run.outcome == "passed"
    verdict = ms.crosscheck(run, KinematicSolver(mechanism, motion_laws=moves))
    assert verdict.passed, verdict
    assert run.motion.drivers == mechanism.drivers
    # a stepped driver has an error of second order within a step, and its rate at the end of each
    for name, value, rate in zip(moves.drivers, *moves.state(run.motion.time)[:2], strict=True):
        assert run.motion.joints[name].rate == pytest.approx(rate, abs=1e-9)
        if method == "pose":
            assert run.motion.joints[name].value == pytest.approx(value, abs=1e-14)


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


def test_a_nonlinear_coupling_of_a_passive_joint_is_stepped():
    mechanism = five_bar_with_cam()
    moves = make_motion_laws(mechanism, ARMS, 1.0)
    run = ms.simulate(mechanism, motion_laws=moves, settings=ms.Settings(steps_per_turn=4000))
    assert run.outcome == "passed"
    joints = run.motion.joints
    law = 0.01 * joints["A"].value + 0.004 * joints["A"].value ** 2
    assert joints["cam"].value == pytest.approx(law, abs=2e-6)
