"""Commands take the reachable range of a crank that swings where no angles are given."""

import json

import numpy as np
import pytest

SWINGS = ("four_bar", "--set", "rocker=35mm")
END = 2.43123


def test_solve_and_simulate_make_one_swing_and_state_so(mechsim):
    done = mechsim("solve", *SWINGS, "--json")
    assert done.code == 0, done.err
    angles = np.array(json.loads(done.out)["columns"]["angle"])
    assert [angles.min(), angles.max()] == pytest.approx([-0.9 * END, 0.9 * END], rel=1e-5)
    assert "the crank swings, its reachable range is -139.299 to 139.299 deg" in done.err
    run = mechsim("simulate", *SWINGS, "-o", "run.csv")
    assert run.code == 0, run.err
    assert "reachable range is -139.299 to 139.299 deg" in run.err
    swung = np.genfromtxt("run.csv", delimiter=",", names=True, deletechars="")["angle"]
    assert [swung.min(), swung.max()] == pytest.approx([-0.9 * END, 0.9 * END], rel=1e-5)


def test_what_is_requested_for_beyond_the_range_is_rejected(mechsim):
    done = mechsim("solve", *SWINGS, "--angles", "0:360:5deg")
    assert done.code == 2
    assert "its range is from -2.43123 to 2.43123 rad" in done.err
    done = mechsim("simulate", *SWINGS, "--turns", "1")
    assert done.code == 2
    assert "cannot make 1 turns" in done.err


def test_a_crank_that_turns_fully_makes_a_turn(mechsim):
    done = mechsim("solve", "four_bar", "--json")
    assert json.loads(done.out)["columns"]["angle"][-1] == pytest.approx(2.0 * np.pi)
    assert done.err == ""
