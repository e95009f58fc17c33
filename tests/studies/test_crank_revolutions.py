"""A swinging crank is driven inside its range on any revolution of its angle."""

import mujoco
import numpy as np
import pytest
from grids import grid
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from strategies import CASES

import mechsim as ms
from mechsim.mechanism.motion_laws import SWING_FRACTION, constant, interval_around, swing
from mechsim.numerics.arrays import REVOLUTION
from mechsim.simulation import simulate
from mechsim.simulation.mjcf.compiling import to_xml
from mechsim.simulation.source import assembled

SWINGING = ("four_bar", "slider_crank", "rssr", "rrsrr", "warp_knitter", "looper")
FRACTIONS = st.floats(0.05, 0.95)


@st.composite
def swings(draw, name):
    """Return a mechanism with a swinging crank and a profile inside its range on any revolution."""
    linkage = draw(CASES[name].random)
    if name == "warp_knitter":
        linkage = linkage.with_parameters(gear_ratio=-2.0, assembly=1)
    try:
        arcs, start = linkage.crank_range(), linkage.mechanism.start
    except ms.AssemblyError:
        assume(False)
    reachable = None if arcs.full else interval_around(arcs, start)
    assume(reachable is not None and reachable[1] - reachable[0] > 0.2)
    low, high = reachable
    angles = np.linspace(low, high, 61)[2:-2]
    assume(linkage.transmission_angle(angles).min() > 0.02)
    middle = low + (high - low) * draw(FRACTIONS)
    reach = SWING_FRACTION * min(middle - low, high - middle) * draw(FRACTIONS)
    return linkage, swing(middle + REVOLUTION * draw(st.sampled_from([-2, -1, 1])), reach, 20.0)


@pytest.mark.long
@pytest.mark.parametrize("name", grid(SWINGING, ("four_bar",)))
@given(data=st.data())
@settings(max_examples=1, phases=[Phase.generate])
def test_every_method_accepts_a_swing_on_any_revolution(name, data):
    linkage, profile = data.draw(swings(name))
    mechanism = linkage.mechanism
    poses = simulate(mechanism, profile=profile, samples=24, method="pose")
    assert poses.outcome == "passed"
    same = 1e-9 * mechanism.characteristic_length
    assert ms.crosscheck(poses.motion, linkage, tolerance=same).passed
    angle = poses.motion.angle
    np.testing.assert_allclose(angle, profile.state(poses.motion.time)[0], rtol=0, atol=1e-12)
    by_loop_equations = ms.loops.solve(mechanism, angle)
    for point, position in linkage.positions(angle).items():
        np.testing.assert_allclose(by_loop_equations.points[point].position, position, rtol=0, atol=same)
    text = to_xml(assembled(mechanism, ms.Scene()))
    model = mujoco.MjModel.from_xml_string(text)
    assert model.joint("crank").qpos0[0] == pytest.approx(mechanism.start, abs=1e-12)
    from_text = simulate(text, profile=profile, samples=24, method="pose")
    assert from_text.outcome == "passed"
    assert ms.crosscheck(from_text.motion, linkage, tolerance=same).passed


def test_a_crank_range_beyond_half_a_turn_sets_the_start():
    linkage = ms.catalog.make(
        "rssr",
        crank=0.018,
        coupler=0.034,
        rocker=0.028,
        pivot=(-0.027, -0.024, -0.026),
        gamma1=-0.78,
        gamma2=1.89,
    )
    assert linkage.mechanism.start > np.pi
    run = simulate(linkage.mechanism, profile=constant(6.0, 0.1, linkage.mechanism.start))
    assert run.outcome == "passed"
    assert run.motion.angle[0] == linkage.mechanism.start
