import numpy as np
import pytest
from exact_solutions import rssr_p3
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from loop_laws import agrees_with_loop_equations
from strategies import EPS, angles_of, rssrs, turns

from mechsim import catalog
from mechsim.errors import AssemblyError

LOOPER = catalog.make(
    "rssr", crank=0.014, coupler=0.048, rocker=0.024, pivot=(0.039, -0.008, 0.004), gamma1=0.0, gamma2=0.0
)


@settings(max_examples=10)
@given(
    rssrs(),
    turns,
    turns,
    st.integers(1000, 2100).map(lambda value: value * 1e-3),
    st.integers(1000, 2100).map(lambda value: value * 1e-3),
    st.sampled_from([1, -1]),
)
def test_a_guided_coupler_keeps_its_angles_to_pin_and_rod(linkage, psi1, psi2, beta1, beta2, guide_branch):
    guide = {"psi1": psi1, "psi2": psi2, "beta1": beta1, "beta2": beta2, "guide_branch": guide_branch}
    angles = angles_of(linkage, count=4, lowest_transmission=0.1)
    try:
        linkage = linkage.with_parameters(guide=True, **guide)
        motion = linkage.solve(angles, 7.0, -3.0)
    except AssemblyError as error:
        assert "the orientation of link 'coupler' is undetermined" in str(error)
        assume(False)
    # as in the paper: a pin fixed in the crank, a direction fixed in the coupler
    c1, s1, c2, s2 = np.cos(psi1), np.sin(psi1), np.cos(psi2), np.sin(psi2)
    x, y, z = -s1 * c2, c1 * c2, s2
    c, s = np.cos(angles), np.sin(angles)
    pin = np.stack([np.full_like(c, x), y * c - z * s, y * s + z * c], 1)
    direction = motion.links["coupler"].rotation @ np.array([np.cos(beta2), 0.0, np.sin(beta2)])
    rod = (motion.points["P2"].position - motion.points["P3"].position) / linkage.coupler
    side = (direction * np.cross(pin, rod)).sum(1)
    assume(np.abs(side).min() > 0.05)
    assert np.abs((pin * direction).sum(1) - np.cos(beta1)).max() <= 100 * EPS
    assert np.abs((rod * direction).sum(1) - np.cos(beta2)).max() <= 100 * EPS
    assert (np.sign(side) == guide_branch).all()
    agrees_with_loop_equations(linkage, motion)


def test_the_guide_does_not_change_the_rocker_motion():
    angles = np.linspace(0.0, 6.0, 20)
    free, guided = (catalog.make("rssr", guide=guide).solve(angles).points["P3"] for guide in (False, True))
    assert (free.position == guided.position).all()


@pytest.mark.parametrize("step", [0.0, 1e-9, -1e-9, 1e-13])
def test_the_motion_is_smooth_where_the_published_form_is_singular(step):
    f = np.arccos(LOOPER.pivot[1] / LOOPER.crank) + step  # P4P2 x axis has no X-component there
    point = LOOPER.solve([f]).points["P3"]
    for measured, exact in zip(
        (point.position[0], point.velocity[0], point.acceleration[0]), rssr_p3(LOOPER, f), strict=True
    ):
        assert np.linalg.norm(measured - exact) <= 1e-13 * np.linalg.norm(exact)


def test_rates_at_a_dead_centre_are_rejected_or_finite():
    linkage = catalog.make("rssr", coupler=0.030)
    for end in linkage.dead_centres():
        for f in (end, np.nextafter(end, 10), np.nextafter(end, -10)):
            try:
                motion = linkage.solve([f])
            except AssemblyError as error:
                assert "dead centre" in str(error) or "does not close" in str(error)
            else:
                assert np.isfinite(motion.points["P3"].acceleration).all()
