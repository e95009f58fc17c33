from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from strategies import CLOSED, EPS, bennetts, longest

from mechsim import loops
from mechsim.analytic.catalog.bennett import Bennett
from mechsim.errors import AssemblyError, InputError
from mechsim.model.links import Pose
from mechsim.simulation import simulate
from mechsim.studies.validate import case_of
from mechsim.theory.structure.mobility_count import mobility

ANGLES = (np.arange(24) + 0.37) * 4.0 * np.pi / 24 - 5.0


def poses_of(motion) -> dict[str, Pose]:
    return {name: Pose(link.position, link.rotation) for name, link in motion.links.items()}


@given(bennetts())
def test_points_and_axes_close_the_loop_at_every_crank_angle(drive):
    motion = drive.solve(ANGLES)
    open_by, turned_by = loops.residual_norms(drive.mechanism, poses_of(motion), ANGLES)
    assert open_by.max() <= CLOSED * longest(drive)
    assert turned_by.max() <= 32 * EPS


@given(bennetts())
def test_rates_satisfy_the_differentiated_loop_equations(drive):
    motion = drive.solve(ANGLES, 7.0, -3.0)
    exact = loops.rates(drive.mechanism, poses_of(motion), ANGLES, 7.0, -3.0)
    # the loop Jacobian loses what the rocker's fastest moment multiplies
    slack = 1e-10 * (abs(drive.ratio) + 1.0 / abs(drive.ratio)) ** 2
    for name, link in motion.links.items():
        for part in ("velocity", "angular_velocity", "acceleration", "angular_acceleration"):
            measured, expected = getattr(link, part), getattr(exact.links[name], part)
            scale = max(np.abs(expected).max(), 49.0)
            assert np.abs(measured - expected).max() <= slack * scale
    for name in ("A", "rocker"):
        for part in ("rate", "acceleration"):
            gap = getattr(motion.joints[name], part) - getattr(exact.joints[name], part)
            assert np.abs(gap).max() <= slack * max(np.abs(getattr(exact.joints[name], part)).max(), 49.0)


@given(bennetts())
def test_half_angle_tangents_have_a_constant_ratio(drive):
    motion = drive.solve(ANGLES)
    rocker, crank = np.tan(0.5 * motion.joints["rocker"].value), np.tan(0.5 * ANGLES)
    assert np.abs(rocker / crank / drive.ratio - 1.0).max() <= 1e-13 * (1.0 + 1.0 / np.abs(crank).min())


@settings(max_examples=20)
@given(bennetts(), st.floats(0.1, 3.0))
def test_b_agrees_with_fifty_digits(drive, angle):
    """B by circle and sphere alone: of the two corners one lies where the axes are met, too."""
    with mp.workdps(50):
        near, far, twist = (mp.mpf(x) for x in (drive.length0, drive.length1, drive.twist0))
        a = mp.matrix([far * mp.cos(angle), far * mp.sin(angle), 0])

        def corner(u):
            arm = mp.matrix([mp.cos(u), mp.sin(u) * mp.cos(twist), mp.sin(u) * mp.sin(twist)])
            return mp.matrix([near, 0, 0]) + far * arm

        motion = drive.solve([angle])
        guess = motion.joints["rocker"].value[0]
        u = mp.findroot(lambda u: mp.norm(corner(u) - a) ** 2 - near**2, guess)
        place = np.array([float(x) for x in corner(u)])
    gap = np.linalg.norm(motion.points["B"].position[0] - place)
    # where both corners come near each other the sphere is a poor witness; length1 itself is rounded
    sharp = abs(np.cos(drive.twist1)) * np.sin(angle) * min(abs(drive.ratio), 1.0 / abs(drive.ratio)) ** 2
    assert gap <= 1e-14 * longest(drive) * (1.0 + (longest(drive) / drive.length0) ** 2) / max(sharp, 1e-6)


@given(bennetts())
def test_the_assembly_sign_distinguishes_the_opposite_twist(drive):
    away = np.abs(np.sin(ANGLES)) > 0.05
    angles = ANGLES[away]
    assume(abs(np.cos(drive.twist1)) > 0.05)
    assert (drive.assembly_sign(drive.positions(angles)) > 0.0).all()
    other_twist = np.sign(drive.twist1) * np.pi - drive.twist1
    assume(abs(other_twist - drive.twist0) > 0.02)
    other = replace(drive, twist1=other_twist)
    assert (drive.assembly_sign(other.positions(angles)) < 0.0).all()


def test_mobility_reports_three_redundant_constraints_and_their_reason():
    freedom = mobility(Bennett().mechanism)
    assert freedom.actual == 1
    assert freedom.somov_malyshev == -2
    assert freedom.redundant == 3
    assert any("3 redundant constraints" in line and "special dimensions" in line for line in freedom.lines())


def test_the_loop_does_not_close_with_a_link_too_long_by_a_thousandth():
    mechanism = Bennett().mechanism
    joints = tuple(
        replace(joint, a=replace(joint.a, point=(1.001 * joint.a.point[0], 0.0, 0.0)))
        if joint.name == "B"
        else joint
        for joint in mechanism.joints
    )
    with pytest.raises(AssemblyError, match="do not close"):
        loops.assemble(replace(mechanism, joints=joints), [1.0])


def test_a_bennett_linkage_passes_validation_by_every_method():
    assert case_of(Bennett()).verdict.outcome == "passed"


@pytest.mark.parametrize("cut", ["A", "B", "rocker"])
def test_every_passive_joint_can_be_the_cut_joint(cut):
    from mechsim.model.scene import Scene

    drive = Bennett()
    run = simulate(drive.mechanism, speed=60.0, scene=Scene(cut=(cut,)), method="step")
    exact = drive.positions(run.motion.angle)["B"]
    assert np.linalg.norm(run.motion.points["B"].position - exact, axis=1).max() <= 1e-8 * drive.length1


@pytest.mark.parametrize(
    ("values", "output"),
    [
        ({"twist1": np.deg2rad(34.0)}, "two different twists"),
        ({"twist1": -1.0}, "one sign"),
        ({"twist0": 0.0}, "between 0 and pi"),
        ({"twist1": 4.0}, "between 0 and pi"),
        ({"length0": -1.0}, "above 0"),
    ],
)
def test_invalid_dimensions_are_rejected_with_a_remedy(values, output):
    with pytest.raises(InputError, match=output):
        Bennett(**values)
