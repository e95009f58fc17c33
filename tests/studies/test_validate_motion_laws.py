"""Mechanisms with several drivers are validated under their motion laws."""

import numpy as np
import pytest

from mechsim.io.readers import load
from mechsim.studies.agreement.evaluation_points import driver_inputs, evaluation_points
from mechsim.studies.validate import case_of

FIVE_BAR = load("five_bar")


@pytest.mark.long
def test_each_driver_has_its_own_check_by_both_methods():
    case = case_of(FIVE_BAR)
    assert case.passed, case.verdict.reason
    reported = {check.title for check in case.verdict.checks if "drive" in check.title}
    assert reported == {f"{route}: drive: {name}" for route in ("pose", "step") for name in ("left", "right")}


def test_a_formula_gets_the_coordinates_of_the_drivers():
    motion = FIVE_BAR.solve(t=np.linspace(0.0, FIVE_BAR.motion_laws.duration, 5))
    inputs = driver_inputs(evaluation_points(FIVE_BAR, 1.0, samples=5))
    assert list(inputs) == ["left", "right"]
    np.testing.assert_allclose(inputs["left"], motion.joints["left"].value, atol=1e-14)
