import numpy as np
import pytest
from hypothesis import assume, given
from strategies import bennetts

from mechsim import catalog
from mechsim.simulation import simulate

ANGLES = (np.arange(24) + 0.37) * 4.0 * np.pi / 24 - 5.0


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
