"""The runner of tables of tests rejects wrong values, unknown keys and rows without a check."""

import pytest
from case_tables import rows_of, run_row
from expected import deviations

SLIDER = {"model": "slider_crank", "call": ".solve", "arguments": [[0.0, 1.0]], "expected": {"joints": {}}}
CRANK = {"value": {"is": [0.0, 1.0], "abs": 1e-15}}


def with_joint(**joint):
    return SLIDER | {"expected": {"joints": {"crank": joint}}}


@pytest.mark.parametrize(
    "wrong",
    [
        {"value": {"is": [0.0, 1.001], "rel": 1e-4}},
        {"value": {"is": [0.0], "abs": 9.0}},
        {"value": {"0": {"above": 0.0}}},
        {"value": {"max": {"below": 1.0}}},
        {"value": {"abs": {"max": {"below": 1.0}}}},
        {"value": {}},
        {"unit": "deg"},
        {"unit": {"has": "deg"}},
        {"unit": {"lacks": "ra"}},
        {"value": {"is": 1.0, "tolerance": 1.0}},
    ],
)
def test_a_wrong_value_fails(wrong, mechsim):
    run_row(with_joint(**CRANK, unit="rad"), mechsim)
    with pytest.raises(AssertionError):
        run_row(with_joint(**wrong), mechsim)


def test_a_missing_path_or_error_fails(mechsim):
    with pytest.raises(AttributeError):
        run_row(with_joint(torque=1.0), mechsim)
    with pytest.raises(pytest.fail.Exception, match="DID NOT RAISE"):
        run_row(SLIDER | {"error": "a word"}, mechsim)
    short = SLIDER | {"load": {"set": {"rod": 0.01}}}
    run_row(short | {"error": "does not close"}, mechsim)
    with pytest.raises(AssertionError):
        run_row(short | {"error": "other words"}, mechsim)


def test_a_command_fails_by_its_code(mechsim):
    row = {"model": "backlash_pair.toml", "command": "show MODEL"}
    run_row(row | {"expected": {"code": 0}}, mechsim)
    with pytest.raises(AssertionError):
        run_row(row | {"expected": {"code": 1}}, mechsim)


def test_mujoco_must_reject_a_changed_model(mechsim):
    row = {"model": "efficiency_hoist.toml", "fields": {"efficiency": 0.8}, "call": "driven"}
    row |= {"options": {"speed": 5.0, "samples": 4}}
    run_row(row | {"mujoco": [[["0.8", "0.9"]]]}, mechsim)
    with pytest.raises(AssertionError):
        run_row(row | {"mujoco": [[["0.8", "0.80"]]]}, mechsim)


@pytest.mark.parametrize("row", [{"expected": {}, "tolerance": 1.0}, {"model": "four_bar"}])
def test_unknown_keys_and_rows_without_a_check_are_rejected(row):
    with pytest.raises(AssertionError):
        rows_of({"a row": row})


def test_cases_change_a_row():
    rows = rows_of(
        {"a row": {"options": {"a": 1, "b": 2}, "expected": {}, "cases": [{"options": {"b": 3}}, {}]}}
    )
    assert {name: row["options"] for name, row in rows.items()} == {
        "a row": {"a": 1, "b": 3},
        "a row, 1": {"a": 1, "b": 2},
    }
    assert deviations({"a": [1.0]}, {"a": {"len": 1}}) == []
