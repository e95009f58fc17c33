"""The validation case of closed forms near dead centres, at a few distances."""

import closed_form_at_dead_centres as case
import numpy as np
import pytest

DISTANCES = np.array([1e-12, 1e-7, 1e-2])


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "rssr", "rrsrr"])
def test_errors_are_at_most_those_of_rounded_inputs(name):
    linkage, point = case.LINKAGES[name]
    error, condition = case.errors(linkage, point, case.angles_near(linkage, DISTANCES))
    assert (error <= case.MAX_UNITS * case.EPS * condition).all()
    # the condition grows as the inverse square root of the distance
    assert condition[0] / condition[2] == pytest.approx(1e5, rel=0.5)


def test_the_published_form_loses_two_digits_at_a_dead_centre():
    linkage = case.dead_centre_at_zero_v3x()
    angles = case.angles_near(linkage, case.DISTANCES)
    error, condition = case.errors(linkage, "P3", angles)
    assert (error <= case.MAX_UNITS * case.EPS * condition).all()
    # 21 units at most, 100 times the error of the closed form
    other = case.published_errors(linkage, angles)
    assert (other / condition).max() > 5.0 * case.EPS
    assert np.median(other / error) > 20.0
