"""Command `mechsim sweep`."""

import json

import pytest
import xarray

from mechsim.analytic.solvers import KinematicSolver

VARY = ("--vary", "crank=20mm:60mm:5", "--vary", "coupler=30mm:100mm:4")


def test_a_sweep_is_written_and_reported(mechsim):
    answer = mechsim("sweep", "four_bar", *VARY, "--measure", "range:rocker", "-o", "out.nc")
    assert answer.code == 0
    assert "20 of 20 designs built" in answer.out
    assert "10 of them swing: they are measured over their reachable ranges" in answer.out
    result = xarray.open_dataset("out.nc")
    assert result["range:rocker"].dims == ("crank", "coupler")
    assert result.attrs["speed"] == pytest.approx(62.83185307)


def test_json_output_is_one_object(mechsim):
    arguments = ("--sample", "sobol:16", "--vary", "crank=12mm:14mm", "--measure", "max:P3.v")
    answer = mechsim("sweep", "rssr", *arguments, "-o", "out.csv", "--json")
    reported = json.loads(answer.out)
    assert (reported["designs"], reported["built"]) == (16, 16)
    assert reported["seconds"] > 0.0


def test_an_invalid_output_path_is_rejected_before_the_sweep(mechsim):
    for name, output in (("out.xls", "choose from .nc"), ("nowhere/out.nc", "create it first")):
        answer = mechsim("sweep", "four_bar", *VARY, "--measure", "range:rocker", "-o", name)
        assert (answer.code, output in answer.err) == (2, True), answer.err


def test_random_designs_are_checked_in_mujoco(mechsim, monkeypatch):
    arguments = ("--vary", "crank=25mm:30mm:3", "--measure", "range:rocker", "--check", "2")
    answer = mechsim("sweep", "four_bar", *arguments, "-o", "out.nc", "--samples", "12")
    assert answer.code == 0
    assert "2 of 2 designs agree with MuJoCo's poses" in answer.out
    # a wrong closed form fails the check
    solve = KinematicSolver.solve
    monkeypatch.setattr(
        KinematicSolver, "solve", lambda self, angles, *rest: solve(self, angles + 0.01, *rest)
    )
    answer = mechsim("sweep", "four_bar", *arguments, "-o", "wrong.nc", "--samples", "12", "--json")
    assert answer.code == 1
    assert json.loads(answer.out)["checked"]["passed"] == 0
