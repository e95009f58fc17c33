"""Invalid parameters and angles of the catalogue are rejected; no result contains NaN."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.kinematics.formulas.closed_form import CHUNK


@pytest.mark.parametrize("pivot", [[0.043, -0.01, -0.024], np.array([0.043, -0.01, -0.024])])
def test_lists_and_arrays_are_valid_vectors(pivot):
    linkage = ms.catalog.make("rssr", pivot=pivot)
    assert linkage == ms.catalog.make("rssr")


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "rssr"])
def test_many_angles_give_the_same_motion_as_single_angles(name):
    linkage = ms.catalog.make(name)
    count = 2 * CHUNK + 1000
    angles = np.linspace(0.0, 40.0, count)
    whole = linkage.solve(angles, speed=np.linspace(1.0, 2.0, count))
    assert len(whole) == count
    for i in (0, CHUNK - 1, CHUNK, count - 1):
        alone = linkage.solve(angles[i : i + 1], speed=float(whole.speed[i]))
        for point, motion in alone.points.items():
            assert np.abs(whole.points[point].acceleration[i] - motion.acceleration[0]).max() <= 1e-13
