from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.analytic.loops.record import with_all_joints
from mechsim.model.motion import select_instants


# joints that turn and slide on moving links: a slide on a lever, crosses of a shaft, a rod's sleeve
@pytest.mark.parametrize("name", ["quick_return", "double_cardan", "rsur"])
def test_joint_motion_from_links_agrees_with_the_loop_equations(name):
    form = ms.load(name)
    start = form.mechanism.start
    exact = form.solve(np.linspace(start, start + 2.0, 41), 3.0, -2.0)
    result = with_all_joints(form.mechanism, replace(exact, joints={})).joints
    assert result.keys() == exact.joints.keys()
    for joint, wanted in exact.joints.items():
        turns = np.round((result[joint].value - wanted.value)[0] / (2.0 * np.pi)) * 2.0 * np.pi
        shift = turns if wanted.unit == "rad" else 0.0
        np.testing.assert_allclose(result[joint].value - shift, wanted.value, atol=1e-12)
        scale = max(1.0, np.abs(wanted.rate).max()), max(1.0, np.abs(wanted.acceleration).max())
        np.testing.assert_allclose(result[joint].rate, wanted.rate, atol=1e-12 * scale[0])
        np.testing.assert_allclose(result[joint].acceleration, wanted.acceleration, atol=1e-11 * scale[1])
        assert (result[joint].unit, result[joint].index) == (wanted.unit, wanted.index)


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_revolutions_between_samples_are_counted_from_the_speed(sense):
    form = ms.load("slider_crank")
    time = 0.02 * np.arange(246)
    angles = sense * 2.0 * np.pi * (time + 0.03 * time**2)
    exact = form.solve(angles, sense * 2.0 * np.pi * (1.0 + 0.06 * time), sense * 0.12 * np.pi)
    # seven tenths of a turn apart at first, and farther as the speed grows
    sparse = select_instants(replace(exact, joints={}, time=time), slice(None, None, 35))
    reported = with_all_joints(form.mechanism, sparse).joints
    assert np.ptp(reported["crank"].value) > 8.0 * np.pi
    for name, item in reported.items():
        dense = exact.joints[name].value
        wanted = (np.unwrap(dense) if item.unit == "rad" else dense)[::35]
        # measured 3e-14
        np.testing.assert_allclose(item.value, wanted, rtol=0, atol=1e-13)


def test_reported_joints_are_kept_and_unknown_ones_omitted():
    form = ms.load("slider_crank")
    exact = form.solve([0.3, 0.4])
    own = replace(exact.joints["crank"], value=np.array([7.0, 8.0]))
    links = {name: item for name, item in exact.links.items() if name != "rod"}
    some = replace(exact, links=links, joints={"crank": own, "beside": own})
    result = with_all_joints(form.mechanism, some).joints
    of_rod = {j.name for j in form.mechanism.joints if "rod" in (j.a.link, j.b.link)}
    assert of_rod
    assert result.keys() == {*exact.joints, "beside"} - of_rod
    assert result["crank"] is result["beside"] is own
