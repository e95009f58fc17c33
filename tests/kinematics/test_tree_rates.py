"""Poses and rates at many instants, in any order, and for drivers off their motion laws."""

from dataclasses import replace

import numpy as np
import pytest
from driven_mechanisms import circle_intersection, five_bar, sinusoidal
from mechanisms import on_one_crank

import mechsim as ms
from mechsim.kinematics.loops.motion import driven_path, motion_along
from mechsim.kinematics.loops.path import CHUNK, rates_of_polynomial
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion import JointMotion
from mechsim.mechanism.motion_laws import make_motion_laws

STEP = 1e-3
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280]) / STEP
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560]) / STEP**2
RATES = {"left": (1.7, -2.3), "right": (-0.9, 3.1)}


def five_bar_solver() -> KinematicSolver:
    mechanism = five_bar()
    states = {"left": sinusoidal(2.0, 0.3, 6.0, 0.2), "right": sinusoidal(1.0, 0.4, 9.0, 1.0)}
    return KinematicSolver(mechanism, motion_laws=make_motion_laws(mechanism, states, 1.0))


def with_offset_drivers(solver: KinematicSolver, offsets):
    """Return the motion with drivers offset from their motion laws, (left, right), at other rates."""
    assert not solver.motion_laws.crank
    motion = solver.solve(t=np.linspace(0.0, 1.0, 12))
    joints = {
        name: JointMotion(
            motion.joints[name].value + offset, *(item * np.ones(12) for item in RATES[name]), "rad"
        )
        for name, offset in zip(RATES, offsets, strict=True)
    }
    return solver.solve_as(replace(motion, joints={**motion.joints, **joints}))


@pytest.mark.parametrize("offsets", [(1e-10, -1e-10), (5e-4, -9e-4), (2e-3, 0.0), (0.05, -0.11), (-0.3, 0.2)])
def test_drivers_off_their_motion_laws_have_the_exact_motion(offsets):
    result = with_offset_drivers(five_bar_solver(), offsets)
    times = STEP * np.arange(-4, 5)
    left, right = (
        result.joints[name].value[:, None] + rate * times + 0.5 * acceleration * times**2
        for name, (rate, acceleration) in RATES.items()
    )
    exact = circle_intersection(left.ravel(), right.ravel()).reshape(12, 9, 2)
    point = result.points["P"]
    # measured 6e-17, 5e-14 and 3e-10
    np.testing.assert_allclose(point.position[:, :2], exact[:, 4], rtol=0, atol=5e-16)
    np.testing.assert_allclose(point.velocity[:, :2], np.tensordot(exact, FIRST, (1, 0)), rtol=0, atol=5e-13)
    np.testing.assert_allclose(
        point.acceleration[:, :2], np.tensordot(exact, SECOND, (1, 0)), rtol=0, atol=3e-9
    )


def test_drivers_out_of_reach_are_rejected_with_the_time():
    for offsets in ((0.9, -0.9), (1.5, 0.0)):
        with pytest.raises(ms.AssemblyError, match=r"the pose at .* s is too near"):
            with_offset_drivers(five_bar_solver(), offsets)


def test_conditioning_is_the_smallest_scaled_singular_value():
    motion = five_bar_solver().solve(t=np.linspace(0.0, 1.0, 9))
    rods = []
    for pivot, arm, driver in ((0.0, 0.05, "left"), (0.1, 0.05, "right")):
        angle = motion.joints[driver].value
        end = np.stack([pivot + arm * np.cos(angle), arm * np.sin(angle)], 1)
        rods.append((motion.points["P"].position[:, :2] - end) / 0.09)
    cosine = (rods[0] * rods[1]).sum(1)
    # smallest singular value of two unit vectors
    exact = 0.09 / five_bar().characteristic_length * np.sqrt(1.0 - np.abs(cosine))
    np.testing.assert_allclose(motion.conditioning, exact, rtol=1e-12)


def test_polynomial_rates_agree_with_the_loop_equations():
    linkage = ms.catalog.make("rssr").mechanism
    path = driven_path(on_one_crank(linkage, linkage))
    angle = path.initial + np.linspace(0.1, 2.0, 7)
    _, motion = motion_along(path, angle, np.ones(7), np.zeros(7))
    assert len(path.loops.tree.balls) == 2
    first, second = (
        rates.T * path.loops.units for rates in rates_of_polynomial(path, path.loops.tree, angle)
    )
    # measured 3.5e-9 and 2.8e-7
    np.testing.assert_allclose(first, motion.rates, rtol=0, atol=4e-8)
    np.testing.assert_allclose(second, motion.second, rtol=0, atol=3e-6)


def test_several_chunks_keep_the_order_of_instants():
    linkage = ms.catalog.make("four_bar")
    angles = np.random.default_rng(22).uniform(-7.0, 7.0, 2 * CHUNK + 300)
    result, exact = (
        ms.loops.solve(linkage.mechanism, angles, 2.0, -3.0).points["B"],
        linkage.solve(angles, 2.0, -3.0).points["B"],
    )
    # measured 8e-17, 8e-17 and 4e-16
    for quantity, most in (("position", 1e-15), ("velocity", 1e-15), ("acceleration", 4e-15)):
        np.testing.assert_allclose(getattr(result, quantity), getattr(exact, quantity), rtol=0, atol=most)
