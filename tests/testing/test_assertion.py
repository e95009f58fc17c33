"""The assertion for test suites: agreement passes; failures report cause and command."""

from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import mechsim as ms
from mechsim.testing.running import RUNNING, RunningTest

CRANK, ROD = 0.05, 0.2


def law(angle, rod=ROD):
    x = CRANK * np.cos(angle) + np.sqrt(rod**2 - (0.01 - CRANK * np.sin(angle)) ** 2)
    return {"B": np.column_stack([x, np.full_like(x, 0.01), np.zeros_like(x)])}


def long_rod(angle):
    return law(angle, 0.21)


@contextmanager
def running(test):
    """Set the running test independent of the plugin; None is outside of a run."""
    token = RUNNING.set(test)
    try:
        yield
    finally:
        RUNNING.reset(token)


def test_an_agreeing_formula_passes():
    assert ms.testing.assert_agrees("slider_crank", law, tolerance=1e-9).passed


def test_a_wrong_formula_fails_with_verdict_cause_and_command():
    with running(None), pytest.raises(AssertionError) as failed:
        ms.testing.assert_agrees("slider_crank", long_rod, tolerance=1e-6)
    lines = str(failed.value).splitlines()
    assert lines[0] == "slider_crank does not agree with long_rod"
    assert lines[1].startswith("  position of B: off by 0.01")
    assert any(line.startswith("cause:  ") for line in lines)
    command = next(line for line in lines if line.startswith("again:"))
    assert command.startswith("again:  mechsim validate slider_crank --against ")
    assert command.endswith(f"{Path(__file__).name}:long_rod")
    assert max(len(line) for line in lines if line is not command) <= 78


@pytest.mark.long
def test_a_test_run_records_junit_properties():
    reported = {}
    test = RunningTest("tests/x.py::test_x", reported.__setitem__)
    with running(test), pytest.raises(AssertionError):
        ms.testing.assert_agrees("slider_crank", long_rod, tolerance=1e-6)
    assert reported["mechsim.outcome"] == "failed"
    assert reported["mechsim.worst"] == "position of B"
    with running(test):
        ms.testing.assert_agrees("slider_crank", law)
    assert reported["mechsim.outcome"] == "passed"


def test_a_local_function_is_reproduced_by_its_test():
    test = RunningTest("tests/x.py::test_x[a b]", lambda name, value: None)
    with running(test), pytest.raises(AssertionError, match=r"again:  pytest 'tests/x\.py::test_x\[a b\]'"):
        ms.testing.assert_agrees("slider_crank", lambda angle: law(angle, 0.3))
