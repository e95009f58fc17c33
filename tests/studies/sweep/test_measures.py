"""Measures: their text form, and their values against the motion."""

import numpy as np
import pytest

from mechsim import catalog
from mechsim.studies.sweep.measures import Turns, measure, table_of

ANGLES = np.linspace(0.0, 2.0 * np.pi, 36, endpoint=False)


@pytest.fixture(scope="module")
def turns():
    """Two turns of one mechanism at different speeds, as if they were two designs."""
    from mechsim.mechanism.motion import join

    solver = catalog.make("rssr")
    motions = [solver.solve(ANGLES, speed) for speed in (1.0, 3.0)]
    motion = join([type(item)(**{k: getattr(item, k) for k in FIELDS}) for item in motions])
    return Turns(2, len(ANGLES), motion)


FIELDS = ("source", "angle", "speed", "acceleration", "points", "joints")


def value(text, turns):
    result = measure(text, catalog.make("rssr").mechanism)
    return result, table_of((result,), turns, {})[text]


def test_measures_equal_those_computed_from_the_motion(turns):
    single = catalog.make("rssr").solve(ANGLES, 3.0)
    rocker, p3 = single.joints["rocker"], single.points["P3"]
    largest_distance = np.linalg.norm(p3.position[:, None] - p3.position, axis=2).max()
    expected = {
        "range:rocker": (np.ptp(rocker.value), "rad"),
        "stroke:P3": (largest_distance, "m"),
        "max:P3.vx": (p3.velocity[:, 0].max(), "m/s"),
        "min:rocker.a": (rocker.acceleration.min(), "rad/s2"),
        "rms:speed:P3": (np.sqrt((p3.velocity**2).sum(1).mean()), "m/s"),
        "mean:P3.z": (p3.position[:, 2].mean(), "m"),
        "max:P3.a": (np.linalg.norm(p3.acceleration, axis=1).max(), "m/s2"),
        "max:acceleration:P3": (np.linalg.norm(p3.acceleration, axis=1).max(), "m/s2"),
    }
    for text, (number, unit) in expected.items():
        result, values = value(text, turns)
        assert result.unit == unit
        assert values[1] == pytest.approx(number, rel=1e-12)


def test_angles_are_continuous_over_the_turn(turns):
    assert value("range:crank", turns)[1][0] == pytest.approx(ANGLES[-1])


def test_a_value_at_an_angle_is_that_of_its_pose(turns):
    result = measure("at:350deg:rocker", catalog.make("rssr").mechanism)
    both = table_of((result,), turns, {result.angle: 35})
    single = catalog.make("rssr").solve(ANGLES[35:]).joints["rocker"].value[0]
    assert both[result.name][0] == pytest.approx(single)


def test_a_function_of_a_motion_is_a_measure(turns, tmp_path):
    path = tmp_path / "own.py"
    path.write_text("def top(motion):\n    return motion.points['P3'].position[:, 2].max()\n")
    _, values = value(f"{path}:top", turns)
    np.testing.assert_array_equal(values, value("max:P3.z", turns)[1])
