"""Mechanisms with several drivers are validated under their motion laws."""

import pytest

from mechsim.io.readers import load
from mechsim.studies.validate import case_of

FIVE_BAR = load("five_bar")


@pytest.mark.long
def test_each_driver_has_its_own_check_by_both_methods():
    case = case_of(FIVE_BAR)
    assert case.passed, case.verdict.reason
    reported = {check.title for check in case.verdict.checks if "drive" in check.title}
    assert reported == {f"{route}: drive: {name}" for route in ("pose", "step") for name in ("left", "right")}
