"""`validate --compare-to` states what became better or worse."""

import json

import pytest

from mechsim.cli.earlier import changes_since


def output(**worst):
    """Return an output with a check of tolerance 1e-6 m for each name; None is an error that is no number."""
    checks = []
    for name, value in worst.items():
        passed = value is not None and value <= 1e-6
        checks.append({"quantity": name, "method": "pose", "unit": "m", "worst": value})
        checks[-1] |= {"tolerance": 1e-6, "passed": passed}
    return {"mechanisms": {"bar": {"checks": checks}}}


@pytest.mark.parametrize(
    ("before", "now", "change"),
    [
        ({"P": 1e-9}, {"P": 2e-6}, "worse"),
        ({"P": 2e-6}, {"P": 1e-9}, "better"),
        ({"P": 2e-7}, {"P": 1e-7}, "better"),
        ({"P": 1e-9}, {"P": None}, "worse"),
        ({"P": None}, {"P": 5e-6}, "better"),
        ({}, {"P": 1e-9}, "new"),
        ({"P": 1e-9}, {}, "gone"),
        # rounding: far below the tolerance
        ({"P": 1e-9}, {"P": 9e-9}, None),
    ],
)
def test_a_change_is_reported(before, now, change):
    earlier = {
        ("bar", check["quantity"], "pose"): check for check in output(**before)["mechanisms"]["bar"]["checks"]
    }
    rows = [
        (row["quantity"], row["before"], row["now"], row["change"])
        for row in changes_since(earlier, output(**now))
    ]
    assert rows == ([("P", before.get("P"), now.get("P"), change)] if change else [])


def test_the_command_compares_with_a_file_and_rejects_others(tmp_path, mechsim):
    data = json.loads(mechsim("validate", "slider_crank", "--json").out)
    data["mechanisms"]["slider_crank"]["checks"][0] |= {"worst": 1.0, "passed": False}
    (tmp_path / "earlier.json").write_text(json.dumps(data))
    compared = ("validate", "slider_crank", "--compare-to", "earlier.json")
    answer = mechsim(*compared, "--json")
    (row,) = json.loads(answer.out)["compared"]
    assert (answer.code, row["change"], row["before"]) == (0, "better", 1.0)
    (tmp_path / "earlier.json").write_text('{"passed": true}')
    answer = mechsim(*compared)
    assert answer.code == 2
    assert "validate --json" in answer.err
