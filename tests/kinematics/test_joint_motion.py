from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.kinematics.loops.record import with_all_joints
from mechsim.mechanism.motion import select_instants


# joints on moving links: a slide on a lever, universal joints of a shaft, a sleeve of a rod
@pytest.mark.parametrize("name", ["quick_return", "double_cardan", "rsur"])
def test_joint_motion_from_links_agrees_with_the_loop_equations(name):
    solver = ms.load(name)
    start = solver.mechanism.start
    exact = solver.solve(np.linspace(start, start + 2.0, 41), 3.0, -2.0)
    result = with_all_joints(solver.mechanism, replace(exact, joints={})).joints
    assert result.keys() == exact.joints.keys()
    for joint, expected in exact.joints.items():
        turns = np.round((result[joint].value - expected.value)[0] / (2.0 * np.pi)) * 2.0 * np.pi
        shift = turns if expected.unit == "rad" else 0.0
        np.testing.assert_allclose(result[joint].value - shift, expected.value, atol=1e-12)
        scale = max(1.0, np.abs(expected.rate).max()), max(1.0, np.abs(expected.acceleration).max())
        np.testing.assert_allclose(result[joint].rate, expected.rate, atol=1e-12 * scale[0])
        np.testing.assert_allclose(result[joint].acceleration, expected.acceleration, atol=1e-11 * scale[1])
        assert (result[joint].unit, result[joint].index) == (expected.unit, expected.index)


@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_revolutions_between_samples_are_counted_from_the_speed(direction):
    solver = ms.load("slider_crank")
    time = 0.02 * np.arange(246)
    angles = direction * 2.0 * np.pi * (time + 0.03 * time**2)
    exact = solver.solve(angles, direction * 2.0 * np.pi * (1.0 + 0.06 * time), direction * 0.12 * np.pi)
    # samples are 0.7 revolutions apart at first, and more as the speed grows
    sparse = select_instants(replace(exact, joints={}, time=time), slice(None, None, 35))
    reported = with_all_joints(solver.mechanism, sparse).joints
    assert np.ptp(reported["crank"].value) > 8.0 * np.pi
    for name, item in reported.items():
        dense = exact.joints[name].value
        expected = (np.unwrap(dense) if item.unit == "rad" else dense)[::35]
        # measured 3e-14
        np.testing.assert_allclose(item.value, expected, rtol=0, atol=1e-13)


def test_reported_joints_are_kept_and_unknown_ones_omitted():
    solver = ms.load("slider_crank")
    exact = solver.solve([0.3, 0.4])
    own = replace(exact.joints["crank"], value=np.array([7.0, 8.0]))
    links = {name: item for name, item in exact.links.items() if name != "rod"}
    motion = replace(exact, links=links, joints={"crank": own, "extra": own})
    result = with_all_joints(solver.mechanism, motion).joints
    of_rod = {j.name for j in solver.mechanism.joints if "rod" in (j.a.link, j.b.link)}
    assert of_rod
    assert result.keys() == {*exact.joints, "extra"} - of_rod
    assert result["crank"] is result["extra"] is own
