"""A mechanism without a coordinate gets no advice to drive one."""

import pytest

import mechsim as ms
from mechsim.mechanism.motion_laws import CRANK


@pytest.mark.parametrize(("kind", "advised"), [("spherical", False), ("revolute", True)])
def test_only_a_coordinate_is_advised_as_a_driver(kind, advised):
    joint = ms.Joint("pivot", kind, ms.End("ground", (0.0, 0.0, 0.0)), ms.End("bob", (0.0, 0.0, 0.0)))
    mechanism = ms.Mechanism(name="pendulum", links=(ms.Link("bob"),), joints=(joint,), driver=(), points={})
    with pytest.raises(ms.InputError) as error:
        CRANK.require_drivers(mechanism)
    assert ("--drive JOINT=LAW" in str(error.value)) is advised
