import numpy as np
import pytest
from hypothesis import assume, given
from strategies import bennetts

from mechsim import catalog
from mechsim.kinematics.mobility_count import mobility
from mechsim.simulation import simulate

ANGLES = (np.arange(24) + 0.37) * 4.0 * np.pi / 24 - 5.0


@given(bennetts())
def test_half_angle_tangents_have_a_constant_ratio(linkage):
    motion = linkage.solve(ANGLES)
    rocker, crank = np.tan(0.5 * motion.joints["rocker"].value), np.tan(0.5 * ANGLES)
    assert np.abs(rocker / crank / linkage.closed_form.ratio - 1.0).max() <= 1e-13 * (
        1.0 + 1.0 / np.abs(crank).min()
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


@pytest.mark.parametrize("cut", ["A", "B", "rocker"])
def test_every_passive_joint_can_be_the_cut_joint(cut):
    from mechsim.mechanism.scene import Scene

    linkage = catalog.make("bennett")
    run = simulate(linkage.mechanism, speed=60.0, scene=Scene(cut=(cut,)), method="step")
    exact = linkage.positions(run.motion.angle)["B"]
    assert (
        np.linalg.norm(run.motion.points["B"].position - exact, axis=1).max()
        <= 1e-8 * linkage.closed_form.length1
    )
