"""The loop equations of mechanisms with several drivers, locked joints, couplings and every joint kind."""

from dataclasses import replace

import numpy as np
import pytest
from driven_mechanisms import (
    boom,
    circle_intersection,
    five_bar,
    platform,
    press,
    rack_and_cam,
    sinusoidal,
    table,
)
from scipy.optimize import brentq

from mechsim.errors import AssemblyError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion_laws import MotionLaws, make_motion_laws, steady, tabled


def at_times(solver: KinematicSolver, count: int = 41):
    moves = solver.motion_laws
    assert moves is not None
    return solver.solve(t=np.linspace(0.0, moves.duration, count))


def require_rates(solver: KinematicSolver):
    """Assert that rates are the derivatives of positions, by eighth-order differences."""
    moves = solver.motion_laws
    step, middle = 1e-3 * moves.duration, 0.4 * moves.duration
    motion = solver.solve(t=(middle + step * np.arange(-4, 5)))
    weights = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / step
    for link in motion.links.values():
        scale = np.abs(link.velocity).max() + 1e-3
        assert weights @ link.position == pytest.approx(link.velocity[4], abs=1e-9 * scale)
        scale = np.abs(link.acceleration).max() + 1e-3
        assert weights @ link.velocity == pytest.approx(link.acceleration[4], abs=1e-8 * scale)
        spin = np.einsum("i,ijk->jk", weights, link.rotation) @ link.rotation[4].T
        scale = np.abs(link.angular_velocity).max() + 1e-3
        observed = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        assert observed == pytest.approx(link.angular_velocity[4], abs=1e-9 * scale)
        scale = np.abs(link.angular_acceleration).max() + 1e-3
        acceleration = weights @ link.angular_velocity
        assert acceleration == pytest.approx(link.angular_acceleration[4], abs=1e-8 * scale)
    return motion


def test_a_five_bar_agrees_with_the_intersection_of_two_circles():
    mechanism = five_bar()
    states = {"left": sinusoidal(2.0, 0.3, 6.0, 0.2), "right": sinusoidal(1.0, 0.4, 9.0, 1.0)}
    solver = KinematicSolver(mechanism, motion_laws=make_motion_laws(mechanism, states, 2.0))
    motion = at_times(solver)
    truth = circle_intersection(motion.joints["left"].value, motion.joints["right"].value)
    assert motion.points["P"].position[:, :2] == pytest.approx(truth, abs=1e-15)
    assert motion.joints["left"].value == pytest.approx(2.0 + 0.3 * np.sin(6.0 * motion.time + 0.2))
    assert [name for name, _ in motion.columns()][:3] == ["t", "left", "right"]
    require_rates(solver)


def test_a_locked_joint_removes_a_dof():
    mechanism = replace(five_bar(), driver="left", locked={"right": 1.2}, start=2.0, guess_coordinates={})
    motion = KinematicSolver(mechanism).solve(np.linspace(1.8, 2.2, 5))
    truth = circle_intersection(motion.angle, np.full(5, 1.2))
    assert motion.points["P"].position[:, :2] == pytest.approx(truth, abs=1e-15)


def test_drivers_out_of_reach_are_rejected_with_the_time():
    mechanism = five_bar()
    states = {"left": steady(2.0, 1.0), "right": steady(1.0, -1.0)}
    solver = KinematicSolver(mechanism, motion_laws=make_motion_laws(mechanism, states, 3.0))

    def arms_apart(time):
        ends = [0.05 * np.exp(1j * (2.0 + time)), 0.1 + 0.05 * np.exp(1j * (1.0 - time))]
        return abs(ends[1] - ends[0]) - 0.18

    when = float(brentq(arms_apart, 0.1, 0.8))
    with pytest.raises(AssemblyError, match=rf"the drivers cannot pass {when:.6g}\d* s"):
        at_times(solver)


def test_a_table_is_a_motion_law():
    time = np.linspace(0.0, 1.0, 41)
    value, rate, _ = tabled("left", time, 2.0 + 0.1 * time**3)(np.array([0.5]))
    assert (value[0], rate[0]) == pytest.approx((2.0 + 0.1 / 8, 0.3 / 4))


def test_a_boom_on_a_cylinder_follows_the_law_of_cosines():
    mechanism = boom()
    solver = KinematicSolver(
        mechanism, motion_laws=make_motion_laws(mechanism, {"stroke": sinusoidal(0.8, 0.1, 2.0)}, 3.0)
    )
    motion = require_rates(solver)
    foot = np.hypot(0.5, 0.2)
    cosine = (1.0 + foot**2 - motion.joints["stroke"].value ** 2) / (2.0 * foot)
    assert motion.joints["lift"].value == pytest.approx(np.arccos(cosine) - np.arctan2(0.2, 0.5), abs=1e-14)


def test_racks_and_polynomial_couplings_follow_their_formulas():
    mechanism = rack_and_cam()
    motion = KinematicSolver(mechanism).solve(np.linspace(-9.0, 9.0, 37), 2.0, 0.5)
    angle = motion.angle
    law = np.polynomial.Polynomial([0.0, 0.0, 0.01, 0.002, -0.001])
    q = angle - 0.1
    assert motion.points["P"].position[:, 0] == pytest.approx(0.001 + 0.02 * angle, abs=1e-15)
    assert motion.points["Q"].position[:, 1] == pytest.approx(0.003 + law(q), rel=1e-12)
    assert motion.points["Q"].velocity[:, 1] == pytest.approx(2.0 * law.deriv()(q), rel=1e-12, abs=1e-13)
    acceleration = 0.5 * law.deriv()(q) + 4.0 * law.deriv(2)(q)
    assert motion.points["Q"].acceleration[:, 1] == pytest.approx(acceleration, rel=1e-12, abs=1e-12)


def test_a_screw_moves_its_nut_by_one_lead_per_revolution():
    mechanism = press()
    motion = KinematicSolver(mechanism).solve(np.linspace(0.0, 20.0, 21))
    height = motion.points["P"].position[:, 2] - 0.1
    # the nut does not rotate: relative to the spindle it rotates backwards
    assert height == pytest.approx(-0.005 * motion.angle / (2.0 * np.pi), abs=1e-15)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_planar_joint_has_two_displacements_and_a_rotation(backwards):
    mechanism = table(backwards=backwards)
    solver = KinematicSolver(
        mechanism, motion_laws=make_motion_laws(mechanism, {"tool": sinusoidal(0.0, 1.0, 3.0)}, 2.0)
    )
    motion = require_rates(solver)
    displacement = motion.joints["plane.x"].value
    assert displacement == pytest.approx(
        np.polynomial.Polynomial([0.01, 0.03, 0.002])(motion.joints["tool"].value), abs=1e-14
    )
    assert [name for name, _ in motion.columns()][-6:-3] != []
    names = [name for name, _ in motion.columns()]
    assert {"plane.q0", "plane.q1", "plane.q2", "plane.a2", "tool.q"} <= {*names}


def test_a_hexapod_reproduces_the_motion_of_its_leg_lengths():
    """Leg lengths of a prescribed motion of the platform reproduce that motion."""
    mechanism, moves, stood = platform()
    assert isinstance(moves, MotionLaws)
    time = np.linspace(0.0, 3.0, 121)
    motion = KinematicSolver(mechanism, motion_laws=moves).solve(t=time)
    assert motion.points["P"].position == pytest.approx(stood(time), abs=1e-13)
