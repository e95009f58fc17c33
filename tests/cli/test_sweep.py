"""`mechsim sweep` as it is typed."""

import json

import numpy as np
import pytest

from mechsim.studies.sweep.table import read_sweep

VARY = ("--vary", "crank=20mm:60mm:5", "--vary", "coupler=30mm:100mm:4")


def test_a_sweep_is_written_and_reported(mechsim):
    done = mechsim("sweep", "four_bar", *VARY, "--measure", "range:rocker", "-o", "out.nc")
    assert done.code == 0
    assert "20 of 20 designs built" in done.out
    assert "10 of them swing: they are measured over their reachable ranges" in done.out
    result = read_sweep("out.nc")
    assert result["range:rocker"].dims == ("crank", "coupler")
    assert result.attrs["speed"] == pytest.approx(62.83185307)


def test_json_is_one_object(mechsim):
    words = (
        "--sample",
        "sobol:16",
        "--vary",
        "crank=25mm:35mm",
        "--measure",
        "max:P3.v",
        "-o",
        "out.csv",
        "--json",
    )
    done = mechsim("sweep", "rssr", *(item.replace("25mm:35mm", "12mm:14mm") for item in words))
    reported = json.loads(done.out)
    assert (reported["designs"], reported["built"]) == (16, 16)
    assert reported["seconds"] > 0.0


@pytest.mark.parametrize(
    ("words", "output"),
    [
        (("--vary", "crnk=1mm:2mm:3"), "did you mean 'crank'"),
        (("--vary", "crank=60mm:20mm:5"), "is in descending order"),
        ((*VARY, "--measure", "rnge:rocker"), "no measure 'rnge:rocker'; did you mean"),
        ((*VARY, "--vary", "crank=1mm:2mm:3"), "twice"),
        ((*VARY, "--design", "none.csv"), "give only one"),
        ((), "no parameter of four_bar varies"),
        ((*VARY, "--samples", "0"), "0 poses"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(mechsim, tmp_path, words, output):
    done = mechsim("sweep", "four_bar", *words, "--measure", "range:rocker", "-o", "out.nc")
    assert done.code == 2
    assert output in done.err
    assert done.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_an_output_that_cannot_be_is_rejected_before_any_work(mechsim):
    for name, output in (("out.xls", "choose from .nc"), ("nowhere/out.nc", "create it first")):
        done = mechsim("sweep", "four_bar", *VARY, "--measure", "range:rocker", "-o", name)
        assert (done.code, output in done.err) == (2, True), done.err


def test_random_designs_go_through_mujoco_and_are_checked(mechsim, monkeypatch):
    words = ("sweep", "four_bar", "--vary", "crank=25mm:30mm:3", "--measure", "range:rocker", "--check", "2")
    done = mechsim(*words, "-o", "out.nc", "--samples", "12")
    assert done.code == 0
    assert "2 of 2 designs agree with MuJoCo's poses" in done.out
    # a closed form that is off is found out
    from mechsim.analytic.catalog.four_bar import FourBar

    solve = FourBar.solve
    monkeypatch.setattr(FourBar, "solve", lambda self, angles, *rest: solve(self, angles + 0.01, *rest))
    done = mechsim(*words, "-o", "wrong.nc", "--samples", "12", "--json")
    assert done.code == 1
    assert json.loads(done.out)["checked"]["passed"] == 0


def test_what_was_swept_is_drawn(mechsim, tmp_path):
    mechsim("sweep", "four_bar", *VARY, "--measure", "range:rocker", "--measure", "max:C.x", "-o", "out.nc")
    for kind in ("map", "parallel", "pareto"):
        assert mechsim("plot", "out.nc", "--kind", kind, "-o", f"{kind}.svg").code == 0
        assert (tmp_path / f"{kind}.svg").stat().st_size > 5000
    done = mechsim("plot", "out.nc", "--of", "range:nothing", "-o", "none.svg")
    assert (done.code, "has no measure 'range:nothing'" in done.err) == (2, True)
    done = mechsim("plot", "out.nc", "--kind", "torque", "-o", "none.svg")
    assert (done.code, "choose from map, parallel, pareto" in done.err) == (2, True)


def test_torques_of_designs_stepped_by_themselves_are_of_loops_as_hard_as_dynamics_has_them(mechsim):
    """At 1e-8 of MuJoCo's compliance, which places need, rack_steering's torque was off by 4e-6 of itself."""
    angles = [f"at:{angle}deg:torque" for angle in (7.2, 36.0, 54.0, 79.2, 198.0, 342.0)]
    words = ("--vary", "radius=5mm:6mm:2", "--samples", "100", *(f"--measure={item}" for item in angles))
    for name, method in (("exact.csv", ()), ("stepped.csv", ("--method", "step"))):
        assert mechsim("sweep", "rack_steering", *words, *method, "-o", name).code == 0
    exact, stepped = (
        np.array([read_sweep(name)[item].values for item in angles]) for name in ("exact.csv", "stepped.csv")
    )
    assert np.abs(stepped - exact).max() < 1e-6 * np.sqrt((exact**2).mean())
