import numpy as np
import pytest

import mechsim as ms
from mechsim.analytic.closure.joint_motion import with_all_joints
from mechsim.model.motion import taken


# joints that turn and slide on moving links: a slide on a lever, crosses of a shaft, a rod's sleeve
@pytest.mark.parametrize("name", ["quick_return", "double_cardan", "rsur"])
def test_joints_read_from_links_move_as_the_loop_equations_say(name):
    form = ms.load(name)
    start = form.mechanism.start
    exact = form.solve(np.linspace(start, start + 2.0, 41), 3.0, -2.0)
    bare = ms.Motion(
        **{key: getattr(exact, key) for key in ("source", "angle", "speed", "acceleration")},
        points=exact.points,
        links=exact.links,
        time=None,
    )
    found = with_all_joints(form.mechanism, bare).joints
    assert found.keys() == exact.joints.keys()
    for joint, wanted in exact.joints.items():
        turns = np.round((found[joint].value - wanted.value)[0] / (2.0 * np.pi)) * 2.0 * np.pi
        shift = turns if wanted.unit == "rad" else 0.0
        np.testing.assert_allclose(found[joint].value - shift, wanted.value, atol=1e-12)
        scale = max(1.0, np.abs(wanted.rate).max()), max(1.0, np.abs(wanted.acceleration).max())
        np.testing.assert_allclose(found[joint].rate, wanted.rate, atol=1e-12 * scale[0])
        np.testing.assert_allclose(found[joint].acceleration, wanted.acceleration, atol=1e-11 * scale[1])
        assert (found[joint].unit, found[joint].part) == (wanted.unit, wanted.part)


def test_turns_between_rows_are_counted_by_the_speed():
    form = ms.load("slider_crank")
    run = ms.simulate(form.mechanism, speed=10.0, turns=3.0, method="pose", samples=72)
    told = with_all_joints(form.mechanism, run.motion).joints
    sparse = with_all_joints(form.mechanism, taken(run.motion, slice(None, None, 24))).joints
    for name, one in told.items():
        np.testing.assert_allclose(sparse[name].value, one.value[::24], atol=1e-9)
