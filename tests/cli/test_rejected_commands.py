"""Invalid command lines: exit code 2, one line that names what is wrong, and no file."""

import shlex
import tomllib

import pytest
from model_files import FOLDER

from mechsim.numerics import resources

TABLES = tomllib.loads((FOLDER.parent / "rejected" / "commands.toml").read_text(encoding="utf-8"))
# table -> memory in bytes that the test reports as free
MEMORY = {"small_memory": 1e9, "large_memory": 1e15}


@pytest.mark.parametrize(
    ("table", "line"),
    [
        pytest.param(table, line, marks=[pytest.mark.long] * (table == "long"))
        for table, lines in TABLES.items()
        for line in lines
    ],
)
def test_an_invalid_command_gives_one_line_and_no_file(table, line, mechsim, tmp_path, monkeypatch):
    if table in MEMORY:
        monkeypatch.setattr(resources, "available_memory", lambda: MEMORY[table])
    words = [str(FOLDER.parent / word) if word.startswith("models/") else word for word in shlex.split(line)]
    answer = mechsim(*words)
    assert (answer.code, answer.out) == (2, "")
    assert len(answer.err.strip().splitlines()) == 1
    assert "Traceback" not in answer.err
    assert [word for word in TABLES[table][line] if word not in answer.err] == []
    assert list(tmp_path.iterdir()) == []
