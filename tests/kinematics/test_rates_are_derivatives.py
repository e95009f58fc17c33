"""Rates are the derivatives of their quantities, in mechanisms with joints of every kind."""

from functools import cache

import mechanisms
import numpy as np
import pytest
from loop_laws import rates_by_six_coordinates
from model_files import model_mechanism

import mechsim as ms

SPEED, ACCELERATION, STEP = 1.3, -2.1, 2e-3
# eighth-order differences
FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0.0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])
MIDDLE = 4


WITHOUT_GEARS = [*mechanisms.everything(), model_mechanism("rates_are_derivatives_rocking_slide.toml")]
# swapping the sides of a coupled joint would reverse its coupling
GEARED = [
    model_mechanism(f"rates_are_derivatives_{name}.toml") for name in ("bevel_wheels", "racks", "plate")
]
KINDS = [*WITHOUT_GEARS, *GEARED]
EVERY = [*KINDS, *(mechanisms.swapped(item) for item in WITHOUT_GEARS)]
NAMES = [item.name for item in KINDS] + [f"{item.name}, sides swapped" for item in WITHOUT_GEARS]
cases = pytest.mark.parametrize("mechanism", EVERY, ids=NAMES)


@cache
def motions(name: str):
    """Return the motion at nine instants by both sets of equations."""
    mechanism = EVERY[NAMES.index(name)]
    time = STEP * (np.arange(9) - MIDDLE)
    angle = mechanism.start + 0.2 + SPEED * time + 0.5 * ACCELERATION * time**2
    speed, acceleration = SPEED + ACCELERATION * time, np.full(9, ACCELERATION)
    whole = ms.loops.solve(mechanism, angle, speed, acceleration)
    poses = {link: ms.Pose(item.position, item.rotation) for link, item in whole.links.items()}
    return rates_by_six_coordinates(mechanism, poses, angle, speed, acceleration), whole


def derivatives(values, weights, order):
    return np.tensordot(weights, values, 1) / STEP**order


def rotation_vectors(rotation):
    """Rotation vectors from the middle one, (n, 3)."""
    rotated = rotation @ rotation[MIDDLE].T
    odd = 0.5 * (rotated[:, [2, 0, 1], [1, 2, 0]] - rotated[:, [1, 2, 0], [2, 0, 1]])
    sine = np.linalg.norm(odd, axis=1)
    return odd * (np.arcsin(sine) / np.where(sine > 0.0, sine, 1.0))[:, None]


def assert_close(result, expected, tolerance):
    assert np.abs(result - expected).max() <= tolerance * max(1.0, np.abs(expected).max())


@cases
def test_rates_of_joints_are_the_derivatives_of_their_coordinates(mechanism, request):
    for motion in motions(request.node.callspec.id):
        assert motion.joints
        for joint in motion.joints.values():
            assert_close(joint.rate[MIDDLE], derivatives(joint.value, FIRST, 1), 1e-10)
            assert_close(joint.acceleration[MIDDLE], derivatives(joint.value, SECOND, 2), 1e-7)
            assert_close(joint.acceleration[MIDDLE], derivatives(joint.rate, FIRST, 1), 1e-9)


@cases
def test_rates_of_points_and_links_are_the_derivatives_of_positions(mechanism, request):
    for motion in motions(request.node.callspec.id):
        for item in (*motion.points.values(), *motion.links.values()):
            assert_close(item.velocity[MIDDLE], derivatives(item.position, FIRST, 1), 1e-10)
            assert_close(item.acceleration[MIDDLE], derivatives(item.velocity, FIRST, 1), 1e-9)
        for link in motion.links.values():
            assert_close(
                link.angular_velocity[MIDDLE], derivatives(rotation_vectors(link.rotation), FIRST, 1), 1e-10
            )
            assert_close(
                link.angular_acceleration[MIDDLE], derivatives(link.angular_velocity, FIRST, 1), 1e-9
            )


@cases
def test_both_sets_of_equations_give_the_same_rates(mechanism, request):
    six, tree = motions(request.node.callspec.id)
    for name, link in six.links.items():
        for quantity in ("velocity", "angular_velocity", "acceleration", "angular_acceleration"):
            assert_close(getattr(tree.links[name], quantity), getattr(link, quantity), 1e-11)
    assert six.points.keys() == tree.points.keys() == mechanism.points.keys()
    assert six.joints.keys() == tree.joints.keys()
    assert tree.joints.keys() == {name for joint in mechanism.joints for name in joint.coordinates}
    for name, joint in six.joints.items():
        turns = (tree.joints[name].value - joint.value) / (2.0 * np.pi if joint.unit == "rad" else np.inf)
        assert_close(tree.joints[name].value, joint.value + 2.0 * np.pi * np.round(turns), 1e-12)
        assert_close(tree.joints[name].rate, joint.rate, 1e-11)
        assert_close(tree.joints[name].acceleration, joint.acceleration, 1e-11)
        assert (tree.joints[name].unit, tree.joints[name].index) == (joint.unit, joint.index)


@cases
def test_solutions_satisfy_the_loop_equations(mechanism, request):
    motion = motions(request.node.callspec.id)[1]
    poses = {link: ms.Pose(item.position, item.rotation) for link, item in motion.links.items()}
    length_residual, angle_residual = ms.loops.residual_norms(mechanism, poses, motion.angle)
    assert length_residual.max() <= 1e-14
    assert angle_residual.max() <= 1e-13


def test_crank_rates_are_scalars_or_one_per_angle():
    mechanism, angles = KINDS[0], np.array([0.7, 0.8, 0.9])
    even = ms.loops.solve(mechanism, angles, SPEED)
    for speed in ([SPEED], [SPEED] * 3):
        for acceleration in (0.0, [0.0], [0.0] * 3):
            same = ms.loops.solve(mechanism, angles, speed, acceleration)
            assert np.array_equal(same.acceleration, np.zeros(3))
            for name, point in even.points.items():
                assert np.array_equal(point.acceleration, same.points[name].acceleration)
    for wrong in ([1.0, 2.0], np.nan, [1.0, np.inf, 1.0], [[1.0]]):
        with pytest.raises(ms.InputError, match="the crank's speed must be finite; give one number, or 3"):
            ms.loops.solve(mechanism, angles, wrong)
