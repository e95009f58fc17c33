"""`mechsim dynamics` from an initial state, statics, modes and frequency response."""

import json

import numpy as np
import pytest

from mechsim import cli


@pytest.fixture
def command(capsys, monkeypatch):
    """Run `mechsim dynamics four_bar` and return exit code, output and errors."""

    def run(*words):
        monkeypatch.setattr("sys.argv", ["mechsim", "dynamics", "four_bar", *words])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        return ended.value.code, *capsys.readouterr()

    return run


@pytest.fixture
def facts(command):
    def run(*words):
        code, out, _ = command(*words, "--json")
        return code, json.loads(out)

    return run


def test_a_crank_is_released_from_an_angle_and_compared_with_mujoco(facts):
    code, run = facts("--initial", "crank.q=30deg", "--duration", "0.1s", "--samples", "10")
    assert code == 0
    assert run["outcome"] == "done"
    assert run["passed"]
    assert run["energy_error"] < 1e-10
    assert {check["method"] for check in run["checks"]} == {"step"}


def test_a_run_ends_at_an_event_and_writes_its_columns(tmp_path, command):
    table = tmp_path / "run.csv"
    words = ["--initial", "crank.v=20", "--until", "crank.q=30deg", "--method", "none", "--csv", str(table)]
    code, out, _ = command(*words)
    assert code == 0
    assert "done at" in out
    header = table.read_text().splitlines()[0].split(",")
    assert {"t", "B.x", "rocker.q", "rocker.v", "rocker.a"} <= {*header}
    data = np.genfromtxt(table, delimiter=",", names=True)
    assert data["crank"][-1] == pytest.approx(np.deg2rad(30.0), abs=1e-10)


def test_an_event_that_is_not_reached_is_reported(facts):
    code, run = facts("--until", "crank.q=900deg", "--duration", "0.01s", "--method", "none")
    assert code == 1
    assert run["outcome"] == "time over"
    assert "was not reached" in run["reason"]


def test_equilibria_are_listed_with_their_stability(facts):
    code, found = facts("--statics", "--initial", "crank.q=30deg")
    assert code == 0
    assert [equilibrium["stable"] for equilibrium in found["equilibria"]] == [True, False]
    assert found["holding"]["crank"] == pytest.approx(0.0035634582077113, rel=1e-9)


def test_modes_have_frequency_damping_ratio_and_shape(facts):
    code, found = facts("--modes", "--initial", "crank.q=-95deg", "--friction", "crank=1e-5,0")
    assert code == 0
    (mode,) = found["modes"]
    assert mode["frequency"] == pytest.approx(4.19234, rel=1e-5)
    assert 0.0 < mode["damping_ratio"] < 1.0
    assert mode["shape"].keys() == {"crank", "A", "B"}


def test_a_frequency_response_is_tabulated(facts):
    code, found = facts("--response", "crank:B.x", "--initial", "crank.q=-95deg")
    assert code == 0
    assert len(found["response"]["frequency"]) == len(found["response"]["magnitude"]) == 200


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--initial", "foo.q=1"], "initial value 'foo.q' is not J.q or J.v"),
        (["--initial", "crank.q=1kg"], "kg"),
        (["--until", "B.x"], "event 'B.x' is not QUANTITY=VALUE"),
        (["--response", "crank"], "--response is 'crank'; give LOAD:QUANTITY"),
        (["--modes", "--initial", "rocker.q=9"], "do not close at the initial values"),
    ],
)
def test_bad_input_ends_in_one_sentence(words, message, command):
    code, _, error = command(*words)
    assert code == 2
    assert message in error
    assert error.count("\n") == 1
