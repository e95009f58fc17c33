import numpy as np
import pytest
from hypothesis import given, settings
from strategies import longest, rrsrrs

import mechsim as ms

SWINGING = ms.catalog.make("rrsrr", pivot=(-0.024, -0.008, 0.040))


@settings(max_examples=30)
@given(rrsrrs())
def test_both_assembly_modes_coincide_at_dead_centres(linkage):
    for end in linkage.dead_centres():
        before, after = linkage.closed_form.discriminant(np.array([end - 1e-6, end + 1e-6]))
        assert before * after < 0.0
    for low, high in linkage.crank_range().arcs if not linkage.crank_range().full else ():
        close = np.array([low + 1e-8 * (high - low), high - 1e-8 * (high - low)])
        first, second = (linkage.with_parameters(branch=branch).positions(close)["S"] for branch in (1, -1))
        assert np.abs(first - second).max() <= 0.02 * longest(linkage)


def test_the_transmission_angle_follows_from_the_transmitted_force():
    linkage = SWINGING
    low, high = linkage.crank_range().arcs[0]
    angles = low + (high - low) * (np.arange(9) + 0.37) / 9
    motion = linkage.solve(angles)
    for i, angle in enumerate(linkage.transmission_angle(angles)):
        coupler, link = (motion.links[name] for name in ("coupler", "link"))
        rod, arm = coupler.rotation[i][:, 0], link.rotation[i][:, 0]
        # no moment about either hinge: force . (hinge x arm) = 0 twice
        swings = np.stack([np.cross(coupler.rotation[i][:, 2], rod), np.cross(link.rotation[i][:, 2], arm)])
        force = np.linalg.svd(swings)[2][2]
        pushed = np.cross(linkage.closed_form.rocker_frame[:, 2], arm)
        assert abs(np.sin(angle) - abs(force @ pushed) / np.linalg.norm(pushed)) <= 1e-12
    assert linkage.transmission_angle([low + 1e-9, high - 1e-9]).max() <= 1e-3


def test_a_rocker_axis_through_the_spherical_joint_is_rejected():
    default, f = ms.catalog.make("rrsrr"), 0.7
    x, y, z = (default.positions([f])["S"][0] - default.pivot) / default.link
    # the axis TY(gamma1) TX(gamma2) eZ along P02S
    linkage = default.with_parameters(gamma1=np.arctan2(x, z), gamma2=np.arcsin(-y))
    assert np.isfinite(linkage.positions([f])["S"]).all()
    for solve in (linkage.solve, linkage.transmission_angle):
        with pytest.raises(ms.AssemblyError, match="S lies on the rocker axis"):
            solve([0.1, f, 1.0])
    assert abs(linkage.solve([f + 1e-3]).joints["link"].value[0]) < np.pi / 2
