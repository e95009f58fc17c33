"""A small fuzzing study: random commands end in a result or one line and leave no incomplete file."""

import importlib
import os
import random
import re
import sys
from pathlib import Path

import fuzz as study
import mutated_files
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


forks = pytest.mark.skipif(not hasattr(os, "fork"), reason="mutants run in forked processes")


@forks
def test_mutated_files_end_in_a_result_or_one_clear_line(tmp_path):
    chance, codes, faults = random.Random(5), [], []
    for number in range(8):
        folder = tmp_path / str(number)
        folder.mkdir()
        code, *reported = mutated_files.run_in_child(mutated_files.random_case(chance), folder)
        codes.append(code)
        faults += reported
    assert faults == []
    # both outcomes occur
    assert {"0", "2"} <= set(codes)


def endless():
    while True:
        pass


@forks
@pytest.mark.parametrize(
    ("wrong", "fault"),
    [
        (lambda: 1 / 0, "exit code 70"),
        (lambda: os.write(2, b"x.py:1: RuntimeWarning: overflow\n"), "a warning on stderr"),
        (lambda: os.kill(os.getpid(), 9), "ended by SIGKILL"),
        # its pages are written
        (lambda: len(bytearray(b"x") * 10**8), "GB"),
        (endless, "ended by SIG(KILL|XCPU)"),
    ],
)
def test_a_seeded_fault_is_reported(monkeypatch, tmp_path, wrong, fault):
    def command():
        wrong()
        sys.exit(0)

    monkeypatch.setattr(mutated_files.cli, "main", command)
    if fault == "GB":
        monkeypatch.setattr(mutated_files, "MEMORY", 10**8)
    monkeypatch.setattr(mutated_files, "SECONDS", 1 if wrong is endless else mutated_files.SECONDS)
    _, *faults = mutated_files.run_in_child(mutated_files.Case(("show",)), tmp_path)
    assert any(re.search(fault, text) for text in faults)
