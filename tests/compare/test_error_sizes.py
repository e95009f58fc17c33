"""Errors of small records, compared with hand calculations or another method."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose
from records import force_record

from mechsim.compare import record_errors as errors
from mechsim.compare.checks import concluded
from mechsim.mechanism.motion import JointMotion, LinkMotion, Motion, PointMotion

N = 7
RANDOM = np.random.default_rng(7)
# of either sign
ANGLE = np.linspace(-0.05, 4.65, N)
FLAT = np.zeros((N, 3))


def rotation_about(axis, angle):
    """Return the rotation about an axis by Rodrigues' formula, (3, 3)."""
    x, y, z = np.asarray(axis) / np.linalg.norm(axis)
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * skew + (1.0 - np.cos(angle)) * skew @ skew


STRAIGHT = np.eye(3)


def motion(rotation=STRAIGHT, joints=None, points=None, links=("rod",), **more):
    orientation = np.broadcast_to(rotation, (N, 3, 3))
    return Motion(
        "closed form",
        ANGLE,
        np.full(N, 2.0),
        np.zeros(N),
        points or {"P": PointMotion(FLAT, FLAT, FLAT)},
        {name: LinkMotion(FLAT, orientation, FLAT, FLAT, FLAT, FLAT) for name in links},
        joints or {},
        **more,
    )


def joint(value, unit="rad"):
    return JointMotion(np.full(N, value), np.zeros(N), np.zeros(N), unit)


forces_of = partial(force_record, ANGLE)


@pytest.mark.parametrize("angle", [1e-9, 1e-3, 0.4, 1.5, 2.5, 3.1])
def test_the_orientation_error_is_the_angle_of_rotation(angle):
    for axis in (*np.eye(3), *RANDOM.normal(size=(5, 3))):
        start = rotation_about(RANDOM.normal(size=3), 1.1)
        result, exact = motion(rotation_about(axis, angle) @ start), motion(start)
        for first, second in ((result, exact), (exact, result)):
            assert_allclose(errors.orientation(first, second, "rod"), angle, rtol=1e-6)


def test_point_errors_are_distances():
    differences = RANDOM.normal(size=(3, N, 3))
    base = RANDOM.normal(size=(3, N, 3))
    exact = motion(points={"P": PointMotion(*base)})
    result = motion(points={"P": PointMotion(*(base + differences))})
    for kind, difference in zip(("position", "velocity", "acceleration"), differences, strict=True):
        assert_allclose(
            errors.of_points(kind)(result, exact, "P"),
            np.hypot(np.hypot(*difference.T[:2]), difference[:, 2]),
        )


@pytest.mark.parametrize("turns", [-3, -1, 0, 1, 2])
@pytest.mark.parametrize("off", [-0.2, 1e-6, 0.5, 3.0])
def test_joint_angles_are_compared_modulo_a_revolution(turns, off):
    exact = motion(joints={"hinge": joint(0.4), "slide": joint(0.4, "m")})
    value = 0.4 + off + 2.0 * np.pi * turns
    result = motion(joints={"hinge": joint(value), "slide": joint(value, "m")})
    assert_allclose(errors.of_joints("rad")(result, exact, "hinge"), abs(off), rtol=1e-8)
    assert_allclose(errors.of_joints("m")(result, exact, "slide"), abs(value - 0.4))
    assert errors.of_joints("rad")(result, exact, "slide") is None
    assert errors.of_joints("m")(result, exact, "hinge") is None


def test_only_common_joints_and_links_are_compared():
    joints = {name: joint(0.0) for name in ("crank", "one", "two")}
    exact = motion(joints=joints, links=("rod", "arm", "loose"), spinning=frozenset({"loose"}))
    result = motion(joints={"crank": joint(0.0), "two": joint(0.0)}, links=("arm", "loose"))
    assert list(errors.joints(result, exact)) == ["two"]
    assert list(errors.links(result, exact)) == ["arm"]
    assert list(errors.points(result, exact)) == ["P"]


def test_the_drive_error_is_the_lag_of_the_crank():
    late = motion(time=ANGLE / 2.0)
    for off in (-0.1, 0.1):
        expected = replace(late, angle=ANGLE + off)
        assert_allclose(errors.drive_angle(late, expected, ""), 0.1)
    assert errors.drive_angle(motion(), late, "") is None


def test_a_field_error_is_a_difference_or_the_field_itself():
    result, exact = forces_of(torque=np.full(N, -3.0)), forces_of(torque=np.full(N, 1.0))
    assert_allclose(errors.field_error("torque")(result, exact, ""), 4.0)
    assert_allclose(errors.field_value("torque")(result, exact, ""), 3.0)
    assert errors.field_value("time")(result, exact, "") is None


def test_torques_at_rest_under_coulomb_friction_are_ignored():
    result, true = forces_of(torque=np.full(N, -2.0)), np.full(N, -3.0)
    # a part of 1e-7 of the fastest counts as standing
    speed = np.full(N, 20.0)
    speed[:4] = 0.0, 1e-6, -1.9e-6, 2.1e-6
    standing = np.ones((N, 2))
    standing[[0, 1, 2, 3, 5], 1] = 0.0
    exact = forces_of(torque=true, speed=speed, sliding=standing)
    assert errors.torque(result, exact, "").tolist() == [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
    assert errors.torque(result, forces_of(torque=true, speed=speed), "").tolist() == [1.0] * N


def test_only_determined_components_of_reactions_are_compared():
    determined = np.array([True, False, True, False, False, True])
    wrong = replace(
        forces_of().reactions["A"],
        force=FLAT + np.array([3.0, 100.0, 4.0]),
        moment=FLAT + np.array([7.0, 100.0, -2.0]),
    )
    shifted = replace(wrong, force=FLAT + 1.0, moment=FLAT - 1.0, determined=determined)
    exact = forces_of(reactions={"A": shifted})
    result = forces_of(reactions={"A": replace(wrong, force=wrong.force + 1.0, moment=wrong.moment - 1.0)})
    assert_allclose(errors.of_reactions("force")(result, exact, "A"), 5.0)
    assert_allclose(errors.of_reactions("moment")(result, exact, "A"), 2.0)
    none = replace(exact.reactions["A"], determined=np.array([False] * 3 + [True] * 3))
    assert errors.of_reactions("force")(result, replace(exact, reactions={"A": none}), "A") is None
    assert errors.of_reactions("moment")(result, replace(exact, reactions={"A": none}), "A") is not None
    for i, kind in enumerate(("force",) * 3 + ("moment",) * 3):
        alone = replace(exact.reactions["A"], determined=np.arange(6) == i)
        error = errors.of_reactions(kind)(result, replace(exact, reactions={"A": alone}), "A")
        assert_allclose(error, np.abs(np.array([3.0, 100.0, 4.0, 7.0, 100.0, -2.0]))[i])


def test_force_errors_of_slides_are_scaled_by_the_length():
    result, exact = (
        forces_of(gears={"a-b": np.full(N, force)}, drives={"ram": np.full(N, 2.0 * force)})
        for force in (5.0, 2.0)
    )
    straight = replace(exact, straight=frozenset({"a-b", "ram"}))
    for true, scale in ((exact, 1.0), (straight, 0.1)):
        assert_allclose(errors.gear_torque(result, true, "a-b"), 3.0 * scale)
        assert_allclose(errors.drive_effort(result, true, "ram"), 6.0 * scale)


def test_reactions_at_a_reversal_of_friction_are_ignored():
    wrong = replace(forces_of().reactions["A"], force=FLAT + 1.0)
    sliding = np.ones((N, 2))
    sliding[2, 1] = 0.0
    exact = forces_of(sliding=sliding, gears={"a-b": np.zeros(N)})
    result = forces_of(reactions={"A": wrong}, gears={"a-b": np.full(N, -1.0)})
    counts = [0.0 if i == 2 else 1.0 for i in range(N)]
    assert_allclose(errors.of_reactions("force")(result, exact, "A"), np.sqrt(3.0) * np.array(counts))
    assert errors.gear_torque(result, exact, "a-b").tolist() == counts
    assert list(errors.gears(result, exact)) == ["a-b"]
    assert list(errors.reactions(result, exact)) == ["A"]


def test_a_verdict_without_checks_does_not_pass():
    verdict = concluded([])
    assert (verdict.outcome, verdict.passed, verdict.reason) == ("failed", False, "nothing was compared")
