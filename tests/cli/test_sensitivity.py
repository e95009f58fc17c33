"""Command `mechsim sensitivity`: table, JSON, rejected input."""

import json

import numpy as np
import pytest

from mechsim import files


@pytest.fixture
def sensitivity(mechsim):
    return lambda *options: mechsim("sensitivity", *options)


def test_derivatives_are_written_and_reported(sensitivity, tmp_path):
    arguments = ("rssr", "--of", "P3,rocker", "--to", "crank,pivot", "--angles", "0:300:100deg")
    code, out, err = sensitivity(*arguments, "-o", "d.csv", "--json")
    assert code == 0, err
    reported = json.loads(out)
    table = files.read(tmp_path / "d.csv")
    names = [f"{q}/{p}" for q in ("P3.x", "P3.y", "P3.z", "rocker.q") for p in reported["dimensions"]]
    assert list(table) == ["angle", *names]
    assert list(reported["dimensions"]) == ["crank", "pivot.x", "pivot.y", "pivot.z"]
    assert reported["units"]["rocker.q/crank"] == "rad/m"
    assert reported["columns"]["P3.x/crank"] == table["P3.x/crank"].tolist()


def test_tolerances_are_reported_and_their_bands_written(sensitivity, tmp_path):
    tolerances = "crank=±0.02mm,coupler=0.03mm,A.clearance=0.01mm"
    arguments = ("four_bar", "--of", "C", "--tolerances", tolerances)
    code, out, err = sensitivity(*arguments, "--angles", "0:360:60deg", "-o", "t.csv", "--json")
    assert code == 0, err
    reported = json.loads(out)["tolerances"]
    item = reported["quantities"]["C.x"]
    assert item["worst"] >= item["rss"] >= item["deviation"] > 0.0
    assert sum(item["shares"].values()) == pytest.approx(1.0)
    assert reported["bounds"]["A.clearance"] == pytest.approx(1e-5)
    table = files.read(tmp_path / "t.csv")
    assert np.abs(table["C.x.worst"].max() - item["worst"]) <= 1e-18
    assert {"C.x/crank", "C.y/coupler", "C.y.rss", "C.y.deviation"} <= set(table)


def test_rounding_sized_derivatives_are_printed_as_zero(sensitivity):
    """The distance of two points of the coupler depends on no other link."""
    code, out, _ = sensitivity("four_bar", "--of", "distance:B,C", "--angles", "0:300:60deg")
    assert code == 0
    derivatives = {row.split()[1]: row.split()[2] for row in out.splitlines()[2:]}
    zero = {name for name, derivative in derivatives.items() if derivative == "0"}
    assert zero == {"ground", "crank", "rocker"}
