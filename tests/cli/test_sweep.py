"""Command `mechsim sweep`."""

import json

import pytest
import xarray

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
