"""Both methods are checked against data of 30 digits, and small errors are reported."""

from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.io import reference_data
from mechsim.studies.reference import by_reference


def table_of(name):
    return reference_data.read(reference_data.folder(), name)


@pytest.mark.long
@pytest.mark.parametrize("name", ["rssr", "five_bar"])
def test_all_methods_agree_with_the_data(name):
    table = table_of(name)
    closed = ms.catalog.make(name) if name == "rssr" else None
    case = by_reference(ms.load(str(table.mechanism)), table, closed)
    assert case.passed, case.reason
    assert {check.method for check in case.checks} >= {"loop equations", "pose"}
    assert {check.kind for check in case.checks} >= {"position", "velocity", "acceleration"}
    assert sum("effort" in check.kind or "torque" in check.kind for check in case.checks) == 2 * len(
        table.drive_forces
    )


def test_a_relative_error_of_1e_10_fails_on_every_method():
    table = table_of("slider_crank")
    point = table.points["B"]
    changed = replace(point, acceleration=point.acceleration * (1.0 + 1e-10))
    wrong = replace(table, points={**table.points, "B": changed})
    case = by_reference(ms.load(str(table.mechanism)), wrong)
    assert case.outcome == "failed"
    failed = {(check.method, check.kind) for check in case.checks if not check.passed}
    assert failed == {("loop equations", "acceleration"), ("pose", "acceleration")}


@pytest.mark.long
def test_a_wrong_force_or_length_fails():
    table = table_of("slider_crank")
    heavy = replace(table, drive_forces={"crank": table.drive_forces["crank"] * (1.0 + 1e-9)})
    case = by_reference(ms.load(str(table.mechanism)), heavy)
    assert {check.kind for check in case.checks if not check.passed} == {"drive torque"}
    long = ms.load(str(table.mechanism), set={"rod": "200.0001mm"})
    assert by_reference(long, table).outcome == "failed"
    assert by_reference(
        ms.load(str(table.mechanism)), table, ms.catalog.make("slider_crank", rod=0.2001)
    ).reason


def test_nan_data_fail():
    table = table_of("four_bar")
    nan_forces = {"crank": np.full(72, np.nan)}
    assert (
        by_reference(ms.load(str(table.mechanism)), replace(table, drive_forces=nan_forces)).outcome
        != "passed"
    )
