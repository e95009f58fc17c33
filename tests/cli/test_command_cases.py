"""Runs of commands, as tables in `tests/commands/`: what is run on which files, what it prints and writes.

A row with `test` starts a test, by its sentence; rows without one continue it. `why` states the
reason and the source of the right values. `models/NAME` is a file of `tests/models`, `reference/PATH`
one of the reference data.
"""

import json
import shlex
import xml.etree.ElementTree as ET

import pytest
from drawing import draws
from expected import PLAIN_MARKERS, deviations, listed, normalised, require_keys, row_parameters
from json_schemas import check_output
from model_files import FOLDER, changed_text

from mechsim import files
from mechsim.io import reference_data

FOLDERS = {"models": FOLDER, "reference": reference_data.folder()}
# words, all of which a text contains, or none; then paths into an output or a table, and expected values
KEYS = {
    *["test", "why", "markers", "variables", "files", "line", "code", "quiet", "repeats", "written", "absent"]
}
KEYS |= {*["out", "err", "not_out", "not_err", "texts", "json", "tables", "out_lines", "err_lines"]}


def words_missing(text, words):
    """Return the words that a text does not contain, whatever its line breaks."""
    return [word for word in listed(words) if normalised(word) not in normalised(text)]


def invalid_file(path):
    """Return whether a file is absent, empty or no picture of its ending."""
    if not path.is_file() or not path.stat().st_size:
        return True
    if path.suffix == ".svg":
        return not ET.parse(path).getroot().tag.endswith("svg")
    start = {".png": b"\x89PNG", ".gif": b"GIF8"}.get(path.suffix, b"")
    return not path.read_bytes().startswith(start)


def check_texts(answer, row, folder):
    """Compare the words of the output and of files with those of a row."""
    assert words_missing(answer.out, row.get("out", [])) == [], answer.out
    assert words_missing(answer.err, row.get("err", [])) == [], answer.err
    for text, key in ((answer.out, "not_out"), (answer.err, "not_err")):
        unwanted = row.get(key, [])
        assert words_missing(text, unwanted) == unwanted, text
    if row.get("quiet"):
        assert answer.err == ""
    for name, words in row.get("texts", {}).items():
        assert words_missing((folder / name).read_text(encoding="utf-8"), words) == []


def check(answer, row, words, folder, before):
    """Compare the answer of a command, and what it wrote, with a row."""
    assert answer.code == row.get("code", 0), answer.err or answer.out
    assert "Traceback" not in answer.err
    if answer.code == 2:
        assert len(answer.err.splitlines()) == 1
        assert len(answer.err) < 1000
        assert {*folder.iterdir()} <= before
    check_texts(answer, row, folder)
    if "json" in row:
        reported = json.loads(answer.out)
        check_output(words, reported)
        assert deviations(reported, row["json"]) == []
    for key, text in (("out_lines", answer.out), ("err_lines", answer.err)):
        assert deviations(text.splitlines(), row.get(key, {})) == []
    for name, expected in row.get("tables", {}).items():
        reported = json.loads(answer.out) if "json" in row else None
        assert deviations(files.read(folder / name), expected, reported) == []
    assert [name for name in row.get("written", []) if invalid_file(folder / name)] == []
    assert [name for name in row.get("absent", []) if (folder / name).exists()] == []


def run_rows(rows, mechsim, folder, monkeypatch):
    """Run the rows of a test in a folder."""
    last = None
    for row in rows:
        require_keys(row, KEYS)
        for name, value in row.get("variables", {}).items():
            monkeypatch.setenv(name, value)
        for name, source in row.get("files", {}).items():
            (folder / name).write_text(changed_text(source), encoding="utf-8", newline="")
        for line in listed(row["line"]):
            triples = (word.partition("/") for word in shlex.split(line))
            words = [
                str(FOLDERS[first] / rest) if first in FOLDERS else first + slash + rest
                for first, slash, rest in triples
            ]
            before = {*folder.iterdir()}
            answer = mechsim(*words)
            check(answer, row, words, folder, before)
            assert not row.get("repeats") or answer.out == last
            last = answer.out


@pytest.mark.parametrize("rows", row_parameters("commands", "run", PLAIN_MARKERS | {"draws": draws}))
def test_a_command_does_what_its_rows_state(rows, mechsim, tmp_path, monkeypatch):
    run_rows(rows, mechsim, tmp_path, monkeypatch)


@pytest.mark.parametrize(
    "wrong",
    [
        {"code": 1},
        {"out": ["mechsim cannot print this"]},
        {"not_out": ["four_bar"]},
        {"texts": {"model.toml": "mechsim cannot write this"}},
        {"json": {"parameters.crank.value": {"is": 0.033, "rel": 1e-3}}},
        {"json": {"parameters.crank.value": {"above": 0.04}}},
        {"json": {"expr:{parameters.crank.value} - 0.03": {"within": 1e-3}}},
        {"json": {"parameters.crank.value": {}}},
        {"json": {"parametres": 1}},
        {"json": {"parameters.crank.value": {"upto": 0.04}}},
        {"out_lines": {"0": "five_bar"}},
        {"written": ["model.svg"]},
        {"absent": ["model.toml"]},
        {"err": "error"},
        {"files": {"a.toml": ["models/finger.xml", "not in the file", ""]}},
        {"words": []},
    ],
    ids=str,
)
def test_a_wrong_row_is_rejected(wrong, mechsim, tmp_path, monkeypatch):
    rows = [{"line": "export four_bar --format toml -o model.toml"}, {"line": "show four_bar --json"}]
    run_rows(rows, mechsim, tmp_path, monkeypatch)
    with pytest.raises((AssertionError, AttributeError, KeyError)):
        run_rows([rows[0], rows[1] | wrong], mechsim, tmp_path, monkeypatch)
