"""Models as tables in `tests/loads/`: what `ms.load` reads of a file, its motion, or why it is rejected.

A row with `test` starts a test, by its sentence; rows without one continue it. `options` are those of
`ms.load`. `call` names a function of mechsim, whose first argument is what is loaded, or a method of it, and
the other arguments. `again` requires the same of the file that `to_toml` writes.
"""

import operator
from typing import Any

import pytest
from expected import deviations, holds, require_keys, row_parameters
from model_files import changed_text

import mechsim as ms
from mechsim.io.toml_writer import to_toml

KEYS = {"test", "why", "markers", "files", "model", "options", "call", "expect", "error", "again"}


def run(row: dict[str, Any]) -> Any:
    """Return what a row loads, or the result of its call."""
    loaded = ms.load(row["model"], **row.get("options", {}))
    if "call" not in row:
        return loaded
    name, arguments = row["call"]
    if hasattr(loaded, name):
        return getattr(loaded, name)(**arguments)
    return operator.attrgetter(name)(ms)(loaded, **arguments)


def check(row: dict[str, Any], folder: Any) -> None:
    """Write the files of a row, and compare what it loads with what it states."""
    require_keys(row, KEYS)
    assert ("expect" in row) != ("error" in row)
    for name, source in row.get("files", {}).items():
        (folder / name).write_text(changed_text(source), encoding="utf-8")
    if "error" in row:
        with pytest.raises(ms.MechsimError) as rejected:
            run(row)
        message = str(rejected.value)
        assert "\n" not in message
        assert holds(message, {"has": row["error"]}), message
        return
    assert deviations(run(row), row["expect"]) == []
    if row.get("again"):
        loaded = ms.load(row["model"], **row.get("options", {}))
        (folder / "again.toml").write_text(to_toml(loaded), encoding="utf-8")
        assert deviations(run(row | {"model": "again.toml"}), row["expect"]) == []


@pytest.mark.parametrize("rows", row_parameters("loads", "load"))
def test_a_model_is_read_as_its_rows_state(rows, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for row in rows:
        check(row, tmp_path)


@pytest.mark.parametrize(
    "wrong",
    [
        {"expect": {"mechanism.name": "five_bar"}},
        {"expect": {"mechanism.joints.0.knd": "revolute"}},
        {"expect": {}, "error": "no"},
        {"error": "is no"},
        {"model": "five_bars", "error": "is no mechanism of this kind"},
        {"expect": {}, "option": {}},
        {},
    ],
    ids=str,
)
def test_a_wrong_row_is_rejected(wrong, tmp_path):
    check({"model": "four_bar", "expect": {"mechanism.name": "four_bar"}}, tmp_path)
    with pytest.raises((AssertionError, AttributeError, pytest.fail.Exception)):
        check({"model": "four_bar"} | wrong, tmp_path)
