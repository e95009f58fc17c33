"""Ratios of successive lengths that the step-size control allows."""

import numpy as np
import pytest

from mechsim.numerics.path_segments import StepControl

CONTROL = StepControl()


def test_the_length_grows_until_the_error_is_the_target():
    assert CONTROL.growth(0.0) == CONTROL.max_growth
    assert CONTROL.growth(CONTROL.target_error) == pytest.approx(1.0)
    assert CONTROL.growth(4.0 * CONTROL.target_error) == pytest.approx(0.25 ** (2 / (CONTROL.nodes + 1)))
    np.testing.assert_allclose(CONTROL.growth(np.array([0.0, CONTROL.target_error])), [3.0, 1.0])


@pytest.mark.parametrize(("correction", "ratio"), [(0.01, 0.75), (0.06, 0.5), (0.004, 2.25)])
def test_the_extrapolation_error_follows_from_distances_to_the_nodes(correction, ratio):
    growth = CONTROL.growth(0.0, correction, ratio)
    current, following = 1.0 + 0.5 * ratio, growth + 0.5
    # distances from the middle of the segment that predicts
    assert correction * ((following) / current) ** CONTROL.nodes == pytest.approx(CONTROL.target_correction)
