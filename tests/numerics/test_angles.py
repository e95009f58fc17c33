"""Revolutions that bring an angle near targets, compared with an exhaustive search."""

import numpy as np
import pytest

from mechsim.numerics.arrays import REVOLUTION, other_revolutions


@pytest.mark.parametrize("angle", [-20.3, -0.4, 0.0, 3.9, 31.0])
@pytest.mark.parametrize(
    "targets", [(0.5,), (0.1, 2.0), (-4.0, 1.5), (-9.0, -3.2), (40.0, 46.0), (-3.0, 12.0)]
)
def test_other_revolutions_match_an_exhaustive_search(angle, targets):
    expected = [
        revolutions
        for revolutions in range(-12, 13)
        if revolutions and all(abs(angle + revolutions * REVOLUTION - item) <= REVOLUTION for item in targets)
    ]
    result = other_revolutions(angle, np.array(targets))
    assert sorted(result) == expected
    assert [abs(revolutions) for revolutions in result] == sorted(abs(revolutions) for revolutions in result)
