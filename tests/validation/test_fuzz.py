"""A small fuzzing study: random commands end in a result or one line and leave no incomplete file."""

import importlib
import sys
from pathlib import Path

import fuzz as study
import numpy as np
import pytest


@pytest.fixture(autouse=True)
def numbers_as_users_have_them():
    # the command line runs with numpy's default settings; warnings are faults
    with np.errstate(over="warn", divide="warn", invalid="warn"):
        yield


def test_random_commands_end_in_a_result_or_one_clear_line():
    codes, faults = study.fuzz(12)
    assert faults == []
    # both outcomes occur
    assert codes[0] >= 2
    assert codes[2] >= 2


@pytest.mark.slow
def test_an_interrupted_command_reports_it_and_leaves_no_file():
    assert study.interrupts(3) == []


@pytest.mark.slow
def test_a_killed_process_leaves_a_complete_file_or_none():
    writing, faults = study.kills(2)
    assert faults == []
    assert writing > 0


def test_the_fuzzer_detects_seeded_faults(monkeypatch, tmp_path):
    def raising():
        raise ZeroDivisionError("oops")

    def leaving():
        Path("half.csv").write_text("time,angle\n1")
        sys.exit(0)

    def two_lines():
        print("one\ntwo", file=sys.stderr)
        sys.exit(2)

    for wrong, output in ((raising, "was not caught"), (leaving, "left half.csv"), (two_lines, "2 lines")):
        monkeypatch.setattr(study, "command_line", wrong)
        _, faults = study.run_case(study.Case(("list",)))
        assert any(output in fault for fault in faults)
    (tmp_path / "out.csv").write_text("a,b\n1,2\n3")
    assert importlib.import_module("command_outcomes").file_defect(tmp_path / "out.csv") is not None
