"""A small study of mutated files: commands end in a result or one clear line."""

import os
import random
import re
import sys

import mutated_files as study
import numpy as np
import pytest

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="mutants run in forked processes")


@pytest.fixture(autouse=True)
def numbers_as_users_have_them():
    # the command line runs with numpy's default settings; warnings are faults
    with np.errstate(over="warn", divide="warn", invalid="warn"):
        yield


def test_mutated_files_end_in_a_result_or_one_clear_line(tmp_path):
    chance, codes, faults = random.Random(5), [], []
    for number in range(8):
        folder = tmp_path / str(number)
        folder.mkdir()
        code, *reported = study.run_in_child(study.random_case(chance), folder)
        codes.append(code)
        faults += reported
    assert faults == []
    # both outcomes occur
    assert {"0", "2"} <= set(codes)


def endless():
    while True:
        pass


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

    monkeypatch.setattr(study.cli, "main", command)
    if fault == "GB":
        monkeypatch.setattr(study, "MEMORY", 10**8)
    monkeypatch.setattr(study, "SECONDS", 1 if wrong is endless else study.SECONDS)
    _, *faults = study.run_in_child(study.Case(("show",)), tmp_path)
    assert any(re.search(fault, text) for text in faults)
