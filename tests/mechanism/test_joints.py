import numpy as np
import pytest
from hypothesis import given
from strategies import EPS, offsets, turns

from mechsim.mechanism.joint_kinds import KINDS, coordinates, displaced, kinds_that

CROSS_ANGLE = 1.1


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
