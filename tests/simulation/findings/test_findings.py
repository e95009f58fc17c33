"""Faults and near misses as a table, `tests/findings.toml`: what the linter reports of each."""

import tomllib

import pytest
from expected import deviations, require_keys
from model_files import FOLDER, changed_text

import mechsim as ms

ROWS = tomllib.loads((FOLDER.parent / "findings.toml").read_text(encoding="utf-8"))["check"]
OF_A_FINDING = ("rule", "kind", "object", "severity", "message", "remedy", "line", "element")
KEYS = {"case", "file", "only", "absent", *OF_A_FINDING}


def check_findings(row, folder):
    """Compare the findings of a changed file with a row."""
    require_keys(row, KEYS)
    assert row.keys() & {"only", "absent", "rule", "kind"}
    text = changed_text(row["file"])
    ending = {"<robot": "urdf", "<mujoc": "xml"}.get(text[:6], "toml")
    path = folder / f"model.{ending}"
    path.write_text(text)
    findings = ms.check(path)
    rules = {finding.rule for finding in findings}
    assert not rules & {*row.get("absent", [])}
    if "only" in row:
        assert {finding.rule for finding in findings if finding.severity != "note"} <= {*row["only"]}
    if row.keys() & {"rule", "kind"}:
        named = [
            f for f in findings if row.get("rule", f.rule) == f.rule and row.get("kind", f.kind) == f.kind
        ]
        assert named, rules
        finding = named[0]
        assert finding.remedy
        requested = {key: row[key] for key in ("object", "severity", "line") if key in row}
        requested |= {key: {"has": row[key]} for key in ("message", "remedy") if key in row}
        assert deviations(finding, requested) == []
        if "element" in row:
            assert row["element"] in text.splitlines()[finding.line - 1]


@pytest.mark.long
@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["case"])
def test_a_file_has_the_findings_of_its_row(row, tmp_path):
    check_findings(row, tmp_path)


@pytest.mark.parametrize(
    "wrong",
    [
        {"only": []},
        {"absent": ["MS102"]},
        {"rule": "MS999"},
        {"rule": "MS102", "object": "rocker"},
        {"rule": "MS102", "severity": "note"},
        {"rule": "MS102", "element": "rocker"},
        {"rule": "MS102", "objects": "loop"},
        {},
    ],
    ids=str,
)
def test_a_wrong_row_is_rejected(wrong, tmp_path):
    row = {"file": ["models/rules_sound.xml", 'pos="0 .08 0"', 'pos="0 .09 0"']}
    check_findings(row | {"rule": "MS102", "object": "loop", "element": "<connect"}, tmp_path)
    with pytest.raises(AssertionError):
        check_findings(row | wrong, tmp_path)
