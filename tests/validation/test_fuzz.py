"""A slice of the fuzzing study: random commands end in a result or one line, killed ones in no half file."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

PATH = Path(__file__).parents[2] / "validation" / "robustness" / "fuzz.py"


@pytest.fixture(scope="module")
def study():
    spec = importlib.util.spec_from_file_location("fuzz", PATH)
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["fuzz"]


@pytest.fixture(autouse=True)
def numbers_as_users_have_them():
    # the command line is used with numpy's own settings; warnings are faults there, too
    with np.errstate(over="warn", divide="warn", invalid="warn"):
        yield


def test_random_commands_end_in_a_result_or_one_clear_line(study):
    codes, faults = study.fuzz(30)
    assert faults == []
    # both kinds are there
    assert codes[0] >= 5
    assert codes[2] >= 5


def test_an_interrupted_command_says_so_and_leaves_nothing(study):
    assert study.interrupts(3) == []


def test_a_killed_process_leaves_a_whole_file_or_none(study):
    hit, faults = study.kills(2)
    assert faults == []
    assert hit > 0


def test_the_fuzzer_knows_a_fault_when_it_meets_one(study, monkeypatch, tmp_path):
    def raising():
        raise ZeroDivisionError("oops")

    def leaving():
        Path("half.csv").write_text("time,angle\n1")
        sys.exit(0)

    def chatting():
        print("one\ntwo", file=sys.stderr)
        sys.exit(2)

    for wrong, said in ((raising, "got through"), (leaving, "left half.csv"), (chatting, "2 lines")):
        monkeypatch.setattr(study, "command_line", wrong)
        _, faults = study.tried(study.Case(("list",)))
        assert any(said in fault for fault in faults)
    (tmp_path / "out.csv").write_text("a,b\n1,2\n3")
    assert study.broken(tmp_path / "out.csv") is not None
