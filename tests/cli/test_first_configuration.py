"""Commands use the assembly sign at the first requested configuration."""

import json

import numpy as np

PARALLELOGRAM = [
    word
    for pair in ("ground=100mm", "crank=40mm", "coupler=100mm", "rocker=40mm")
    for word in ("--set", pair)
]


def deviation(columns):
    """Return the largest deviation of AB from the direction of the frame, in [m]."""
    x, y = (np.array(columns[f"B.{axis}"]) - np.array(columns[f"A.{axis}"]) for axis in "xy")
    return float(np.max(np.hypot(x - 0.1, y)))


def deviation_of_solve(mechsim, *arguments):
    result = mechsim("solve", "four_bar", *PARALLELOGRAM, "--json", *arguments)
    assert result.code == 0, result.err
    return deviation(json.loads(result.out)["columns"])


def test_a_parallelogram_is_solved_in_its_assembly_mode(mechsim):
    assert deviation_of_solve(mechsim, "--angles", "1:359:1deg") <= 1e-15
    assert deviation_of_solve(mechsim) <= 1e-15
    assert deviation_of_solve(mechsim, "--angles", "181:359:1deg", "--set", "branch=-1") <= 1e-15
    assert deviation_of_solve(mechsim, "--angles", "1:359:1deg", "--set", "branch=-1") > 0.01
    assert deviation_of_solve(mechsim, "--angles", "181:359:1deg") > 0.01


def test_simulate_and_dynamics_agree_with_solve(mechsim):
    result = mechsim("simulate", "four_bar", *PARALLELOGRAM, "-o", "run.csv")
    assert result.code == 0, result.err
    rows = np.genfromtxt("run.csv", delimiter=",", names=True, deletechars="")
    assert deviation({name: rows[name] for name in rows.dtype.names}) <= 1e-12
    result = mechsim("dynamics", "inverse", "four_bar", *PARALLELOGRAM, "--turns", "-0.4", "--samples", "20")
    assert result.code == 0, result.err
