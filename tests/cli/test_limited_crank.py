"""Without given angles, commands use the reachable range of a swinging crank."""

import json

import numpy as np
import pytest

SWINGS = ("four_bar", "--set", "rocker=35mm")
END = 2.43123


def test_solve_and_simulate_cover_one_swing_with_a_note(mechsim):
    answer = mechsim("solve", *SWINGS, "--json")
    assert answer.code == 0, answer.err
    angles = np.array(json.loads(answer.out)["columns"]["angle"])
    assert [angles.min(), angles.max()] == pytest.approx([-0.9 * END, 0.9 * END], rel=1e-5)
    assert "the crank swings, its reachable range is -139.299 to 139.299 deg" in answer.err
    run = mechsim("simulate", *SWINGS, "-o", "run.csv")
    assert run.code == 0, run.err
    assert "reachable range is -139.299 to 139.299 deg" in run.err
    swung = np.genfromtxt("run.csv", delimiter=",", names=True, deletechars="")["angle"]
    assert [swung.min(), swung.max()] == pytest.approx([-0.9 * END, 0.9 * END], rel=1e-5)
