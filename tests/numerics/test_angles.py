"""Laps: which turns bring an angle near wanted ones, reported by trying them all."""

import numpy as np
import pytest

from mechsim.numerics.angles import REVOLUTION, other_revolutions


def test_a_turn_is_the_way_round_a_circle_of_radius_one():
    assert abs(np.exp(1j * REVOLUTION) - 1.0) < 1e-15
    assert 6.2 < REVOLUTION < 6.3


@pytest.mark.parametrize("angle", [-20.3, -0.4, 0.0, 3.9, 31.0])
@pytest.mark.parametrize(
    "wanted", [(0.5,), (0.1, 2.0), (-4.0, 1.5), (-9.0, -3.2), (40.0, 46.0), (-3.0, 12.0)]
)
def test_other_laps_are_all_from_which_every_wanted_angle_lies_within_a_turn_nearest_first(angle, wanted):
    near = [
        laps
        for laps in range(-12, 13)
        if laps and all(abs(angle + laps * REVOLUTION - one) <= REVOLUTION for one in wanted)
    ]
    found = other_revolutions(angle, np.array(wanted))
    assert sorted(found) == near
    assert [abs(laps) for laps in found] == sorted(abs(laps) for laps in found)
