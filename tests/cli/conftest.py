"""The command line, called in this process."""

import sys
from pathlib import Path

import pytest
from typed_call import Answer, Call

from mechsim.cli import main


@pytest.fixture
def mechsim(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Call:
    """Return a function that runs a command in an empty folder."""
    monkeypatch.chdir(tmp_path)

    def call(*arguments: str) -> Answer:
        monkeypatch.setattr(sys, "argv", ["mechsim", *arguments])
        with pytest.raises(SystemExit) as ended:
            main()
        output = capsys.readouterr()
        return Answer(int(ended.value.code or 0), output.out, output.err)

    return call
