"""Motion laws: a crank at any speed is one of them, for every solver."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.mechanism.motion_laws import CRANK

LAWS = {"left": "110deg + 20deg*sin(2*pi*t)", "right": "60deg + 15deg*cos(3*t)"}


def test_path_parameters_and_times_are_consistent():
    laws = ms.load("five_bar", drive=LAWS, duration="0.5 s").motion_laws
    assert laws.axis == "t"
    assert laws.path_speed(3.0) == laws.rate
    times = np.linspace(0.0, 0.5, 5)
    np.testing.assert_allclose(laws.time(laws.parameter(times)), times, rtol=1e-15, atol=1e-16)
    np.testing.assert_allclose(laws.spread(5), laws.parameter(times), rtol=1e-15, atol=1e-16)
    value, first, second = laws.along_path(laws.parameter(times))
    for result, expected in zip(
        (value, first * laws.rate, second * laws.rate**2), laws.state(times), strict=True
    ):
        np.testing.assert_allclose(result, expected, rtol=1e-13, atol=1e-14)


@pytest.mark.parametrize(("kind", "advised"), [("spherical", False), ("revolute", True)])
def test_only_a_coordinate_is_advised_as_a_driver(kind, advised):
    joint = ms.Joint("pivot", kind, ms.End("ground", (0.0, 0.0, 0.0)), ms.End("bob", (0.0, 0.0, 0.0)))
    mechanism = ms.Mechanism(name="pendulum", links=(ms.Link("bob"),), joints=(joint,), driver=(), points={})
    with pytest.raises(ms.InputError) as error:
        CRANK.require_drivers(mechanism)
    assert ("--drive JOINT=LAW" in str(error.value)) is advised
