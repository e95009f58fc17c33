from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from strategies import CLOSED, EPS, bennetts, longest

from mechsim import catalog, loops
from mechsim.errors import AssemblyError, InputError
from mechsim.model.links import Pose
from mechsim.simulation import simulate
from mechsim.studies.validate import case_of
from mechsim.theory.mobility_count import mobility

ANGLES = (np.arange(24) + 0.37) * 4.0 * np.pi / 24 - 5.0


def poses_of(motion) -> dict[str, Pose]:
    return {name: Pose(link.position, link.rotation) for name, link in motion.links.items()}


@given(bennetts())
def test_points_and_axes_close_the_loop_at_every_crank_angle(linkage):
    motion = linkage.solve(ANGLES)
    length_residual, angle_residual = loops.residual_norms(linkage.mechanism, poses_of(motion), ANGLES)
    assert length_residual.max() <= CLOSED * longest(linkage)
    assert angle_residual.max() <= 32 * EPS


@given(bennetts())
def test_rates_satisfy_the_differentiated_loop_equations(linkage):
    motion = linkage.solve(ANGLES, 7.0, -3.0)
    exact = loops.rates(linkage.mechanism, poses_of(motion), ANGLES, 7.0, -3.0)
    # the loop Jacobian loses accuracy with the largest rate of the rocker
    slack = 1e-10 * (abs(linkage.closed_form.ratio) + 1.0 / abs(linkage.closed_form.ratio)) ** 2
    for name, link in motion.links.items():
        for quantity in ("velocity", "angular_velocity", "acceleration", "angular_acceleration"):
            measured, expected = getattr(link, quantity), getattr(exact.links[name], quantity)
            scale = max(np.abs(expected).max(), 49.0)
            assert np.abs(measured - expected).max() <= slack * scale
    for name in ("A", "rocker"):
        for quantity in ("rate", "acceleration"):
            difference = getattr(motion.joints[name], quantity) - getattr(exact.joints[name], quantity)
            assert np.abs(difference).max() <= slack * max(
                np.abs(getattr(exact.joints[name], quantity)).max(), 49.0
            )


@given(bennetts())
def test_half_angle_tangents_have_a_constant_ratio(linkage):
    motion = linkage.solve(ANGLES)
    rocker, crank = np.tan(0.5 * motion.joints["rocker"].value), np.tan(0.5 * ANGLES)
    assert np.abs(rocker / crank / linkage.closed_form.ratio - 1.0).max() <= 1e-13 * (
        1.0 + 1.0 / np.abs(crank).min()
    )


@settings(max_examples=20)
@given(bennetts(), st.floats(0.1, 3.0))
def test_b_agrees_with_fifty_digits(linkage, angle):
    """B is an intersection of circle and sphere; one of the two also satisfies the axis conditions."""
    with mp.workdps(50):
        length0, length1, twist = (
            mp.mpf(x) for x in (linkage.length0, linkage.closed_form.length1, linkage.twist0)
        )
        a = mp.matrix([length1 * mp.cos(angle), length1 * mp.sin(angle), 0])

        def corner(u):
            arm = mp.matrix([mp.cos(u), mp.sin(u) * mp.cos(twist), mp.sin(u) * mp.sin(twist)])
            return mp.matrix([length0, 0, 0]) + length1 * arm

        motion = linkage.solve([angle])
        guess = motion.joints["rocker"].value[0]
        u = mp.findroot(lambda u: mp.norm(corner(u) - a) ** 2 - length0**2, guess)
        position = np.array([float(x) for x in corner(u)])
    difference = np.linalg.norm(motion.points["B"].position[0] - position)
    # close intersections are ill-conditioned, and length1 itself is rounded
    sharp = (
        abs(np.cos(linkage.twist1))
        * np.sin(angle)
        * min(abs(linkage.closed_form.ratio), 1.0 / abs(linkage.closed_form.ratio)) ** 2
    )
    assert difference <= 1e-14 * longest(linkage) * (1.0 + (longest(linkage) / linkage.length0) ** 2) / max(
        sharp, 1e-6
    )


@given(bennetts())
def test_the_assembly_sign_distinguishes_the_opposite_twist(linkage):
    away = np.abs(np.sin(ANGLES)) > 0.05
    angles = ANGLES[away]
    assume(abs(np.cos(linkage.twist1)) > 0.05)
    assert (linkage.assembly_sign(linkage.positions(angles)) > 0.0).all()
    other_twist = np.sign(linkage.twist1) * np.pi - linkage.twist1
    assume(abs(other_twist - linkage.twist0) > 0.02)
    other = linkage.with_parameters(twist1=other_twist)
    assert (linkage.assembly_sign(other.positions(angles)) < 0.0).all()


def test_mobility_reports_three_redundant_constraints_and_their_reason():
    dofs = mobility(catalog.make("bennett").mechanism)
    assert dofs.actual == 1
    assert dofs.somov_malyshev == -2
    assert dofs.redundant == 3
    assert any("3 redundant constraints" in line and "special dimensions" in line for line in dofs.lines())


def test_the_loop_does_not_close_with_a_link_too_long_by_a_thousandth():
    mechanism = catalog.make("bennett").mechanism
    joints = tuple(
        replace(joint, a=replace(joint.a, point=(1.001 * joint.a.point[0], 0.0, 0.0)))
        if joint.name == "B"
        else joint
        for joint in mechanism.joints
    )
    with pytest.raises(AssemblyError, match="do not close"):
        loops.assemble(replace(mechanism, joints=joints), [1.0])


def test_a_bennett_linkage_passes_validation_by_every_method():
    assert case_of(catalog.make("bennett")).verdict.outcome == "passed"


@pytest.mark.parametrize("cut", ["A", "B", "rocker"])
def test_every_passive_joint_can_be_the_cut_joint(cut):
    from mechsim.model.scene import Scene

    linkage = catalog.make("bennett")
    run = simulate(linkage.mechanism, speed=60.0, scene=Scene(cut=(cut,)), method="step")
    exact = linkage.positions(run.motion.angle)["B"]
    assert (
        np.linalg.norm(run.motion.points["B"].position - exact, axis=1).max()
        <= 1e-8 * linkage.closed_form.length1
    )


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
        catalog.make("bennett", **values)
