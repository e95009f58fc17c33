"""Invalid command lines: exit code 2, one line that names what is wrong, and no file."""

import shlex
import tomllib
from pathlib import Path

import pytest
from model_files import FOLDER
from typed_call import Call

TABLES = tomllib.loads((FOLDER.parent / "rejected" / "commands.toml").read_text(encoding="utf-8"))
LINES = TABLES["quick"] | TABLES["long"]


@pytest.mark.parametrize(
    "line", [*TABLES["quick"], *(pytest.param(line, marks=pytest.mark.long) for line in TABLES["long"])]
)
def test_an_invalid_command_gives_one_line_and_no_file(line: str, mechsim: Call, tmp_path: Path) -> None:
    words = [str(FOLDER.parent / word) if word.startswith("models/") else word for word in shlex.split(line)]
    answer = mechsim(*words)
    assert (answer.code, answer.out) == (2, "")
    assert len(answer.err.strip().splitlines()) == 1
    assert "Traceback" not in answer.err
    assert [word for word in LINES[line] if word not in answer.err] == []
    assert list(tmp_path.iterdir()) == []
