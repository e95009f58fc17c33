import numpy as np
import pytest
from hypothesis import given
from strategies import EPS, offsets, turns

from mechsim.mechanism.joint_kinds import KINDS, coordinates, displaced, kinds_that

CROSS_ANGLE = 1.1


@pytest.mark.parametrize(
    ("name", "dofs", "forces", "moments", "units"),
    [
        ("revolute", 1, 3, 2, ("rad",)),
        ("prismatic", 1, 2, 3, ("m",)),
        ("cylindrical", 2, 2, 2, ("m", "rad")),
        ("universal", 2, 3, 1, ("rad", "rad")),
        ("spherical", 3, 3, 0, ()),
        ("planar", 3, 1, 2, ("m", "m", "rad")),
        ("fixed", 0, 3, 3, ()),
        ("floating", 6, 0, 0, ("m", "m", "m")),
    ],
)
def test_joint_kinds_have_their_degrees_of_freedom(name, dofs, forces, moments, units):
    kind = KINDS[name]
    assert (kind.dof, kind.forces, kind.moments, kind.units) == (dofs, forces, moments, units)


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
@given(offsets, offsets, turns, turns)
def test_coordinates_are_the_inverse_of_displacements(kind, first, second, angle, other):
    lengths, angles = iter((first, second, first)), iter((angle, other))
    values = [next(lengths if unit == "m" else angles) for unit in kind.units]
    shift, rotation = displaced(kind, values, CROSS_ANGLE)
    result = coordinates(kind, shift, np.eye(3), rotation, CROSS_ANGLE)
    assert result.shape == (len(kind.units),)
    assert np.abs(result - values).max(initial=0.0) <= 16 * EPS * np.pi


def test_matching_joint_kinds_are_listed_by_name():
    assert kinds_that(lambda kind: kind.single).startswith("revolute or prismatic")
    assert kinds_that(lambda kind: kind.mixed).startswith("cylindrical")
    assert kinds_that(lambda kind: kind.dof > 6) == ""
