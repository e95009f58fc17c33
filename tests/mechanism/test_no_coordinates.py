"""A mechanism without a coordinate gets no advice to drive one."""

import pytest

from mechsim.errors import InputError
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.links import Link
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import CRANK


@pytest.mark.parametrize(("kind", "advised"), [("spherical", False), ("revolute", True)])
def test_only_a_coordinate_is_advised_as_a_driver(kind, advised):
    joint = Joint("pivot", kind, End("ground", (0.0, 0.0, 0.0)), End("bob", (0.0, 0.0, 0.0)))
    mechanism = Mechanism(name="pendulum", links=(Link("bob"),), joints=(joint,), driver=(), points={})
    with pytest.raises(InputError) as error:
        CRANK.require_drivers(mechanism)
    assert ("--drive JOINT=LAW" in str(error.value)) is advised
