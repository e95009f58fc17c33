"""A small study of mutated files: commands end in a result or one clear line."""

import os
import random
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


@pytest.mark.parametrize(
    ("wrong", "fault"),
    [
        (lambda: 1 / 0, "exit code 70"),
        (lambda: os.write(2, b"x.py:1: RuntimeWarning: overflow\n"), "a warning on stderr"),
        (lambda: os.kill(os.getpid(), 9), "ended by SIGKILL"),
    ],
)
def test_a_seeded_fault_is_reported(monkeypatch, tmp_path, wrong, fault):
    def command():
        wrong()
        sys.exit(0)

    monkeypatch.setattr(study.cli, "main", command)
    _, *faults = study.run_in_child(study.Case(("show",)), tmp_path)
    assert any(fault in text for text in faults)


def test_memory_over_the_limit_is_reported(monkeypatch, tmp_path):
    def command():
        # its pages are written
        assert len(bytearray(b"x") * 10**8) == 10**8
        sys.exit(0)

    monkeypatch.setattr(study.cli, "main", command)
    monkeypatch.setattr(study, "MEMORY", 10**8)
    _, *faults = study.run_in_child(study.Case(("show",)), tmp_path)
    assert any("GB" in text for text in faults)


def test_a_command_that_does_not_end_is_stopped(monkeypatch, tmp_path):
    def command():
        while True:
            pass

    monkeypatch.setattr(study.cli, "main", command)
    monkeypatch.setattr(study, "SECONDS", 1)
    _, *faults = study.run_in_child(study.Case(("show",)), tmp_path)
    assert any("ended by SIGKILL" in text or "ended by SIGXCPU" in text for text in faults)
