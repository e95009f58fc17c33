"""A sweep has the measures of single designs, and an invalid design does not end it."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.studies.sweep.methods import by_one_formula
from mechsim.studies.sweep.sweeping import swept_task

ANGLES = 2.0 * np.pi * np.arange(72) / 72
COUPLERS = np.array([0.03, 0.085, 0.091, 0.1])


def test_a_vectorised_formula_has_the_measures_of_single_designs():
    result = ms.sweep(
        "four_bar", {"coupler": COUPLERS, "arm_angle": [0.3, 0.5]}, ["range:rocker", "max:C.v"], speed=3.0
    )
    assert result["range:rocker"].dims == ("coupler", "arm_angle")
    assert result["outcome"].values[:, 0].tolist() == ["swings", "passed", "passed", "passed"]
    for coupler in COUPLERS[1:]:
        motion = ms.catalog.make("four_bar", coupler=coupler, arm_angle=0.5).solve(ANGLES, 3.0)
        item = result.sel(coupler=coupler, arm_angle=0.5)
        assert float(item["range:rocker"]) == pytest.approx(np.ptp(motion.joints["rocker"].value), rel=1e-12)
        fastest = np.linalg.norm(motion.points["C"].velocity, axis=1).max()
        assert float(item["max:C.v"]) == pytest.approx(fastest, rel=1e-12)


def test_invalid_designs_report_a_reason_and_do_not_end_the_sweep():
    design = {"crank": [0.032, -1.0, 1e40, np.inf, 0.09, 0.5], "branch": [1, 1, 1, 1, 1, 7]}
    result = ms.sweep("four_bar", measure=["range:rocker"], design=design)
    assert result["outcome"].values.tolist() == ["passed"] + ["cannot assemble"] * 3 + [
        "swings",
        "cannot assemble",
    ]
    assert np.isnan(result["range:rocker"].values[[1, 2, 3, 5]]).all()
    output = result["reason"].values.tolist()
    assert output[0] == ""
    for word, reason in zip(
        ("above 0", "finite", "finite", "the crank swings from", "branch"), output[1:], strict=True
    ):
        assert word in reason


@pytest.mark.long
def test_a_gallery_model_is_measured_by_its_loop_equations():
    cranks = {"crank": [0.02, 0.025, 0.3]}
    result = ms.sweep(ms.load("watt_six_bar"), cranks, ["range:output", "at:90deg:D.x"])
    assert result["outcome"].values.tolist() == ["passed", "passed", "cannot assemble"]
    single = ms.load("watt_six_bar", {"crank": 0.02})
    expected = np.ptp(single.solve(ANGLES).joints["output"].value)
    assert float(result["range:output"][0]) == pytest.approx(expected, rel=1e-9)
    x = single.solve([np.pi / 2]).points["D"].position[0, 0]
    assert float(result["at:90deg:D.x"][0]) == pytest.approx(x, rel=1e-9)


def test_forces_and_transmission_angles_are_measured():
    result = ms.sweep(
        "rssr", {"crank": [0.012, 0.013]}, ["max:torque", "max:force:P3", "min:transmission"], speed=50.0
    )
    solver = ms.catalog.make("rssr", crank=0.012)
    study = ms.dynamics.prescribed(ms.dynamics.dynamic_model(solver), ANGLES, 50.0)
    assert float(result["max:torque"][0]) == pytest.approx(study.forces.torque.max())
    force = np.linalg.norm(study.forces.reactions["P3"].force, axis=1).max()
    assert float(result["max:force:P3"][0]) == pytest.approx(force)
    assert float(result["min:transmission"][0]) == pytest.approx(solver.transmission_angle(ANGLES).min())
    assert result["max:force:P3"].attrs["units"] == "N"


def test_only_array_parameters_use_a_vectorised_formula():
    assert by_one_formula(swept_task("rssr", {"gamma1": [0.1]}, "range:rocker"))
    assert not by_one_formula(swept_task("looper", {"crank": [0.006]}, "range:rocker"))
    assert not by_one_formula(swept_task("rssr", {"psi1": [0.1]}, "range:rocker", set={"guide": "true"}))
    assert not by_one_formula(swept_task("rssr", {"gamma1": [0.1]}, "max:torque"))
    assert not by_one_formula(swept_task("watt_six_bar", {"crank": [0.1]}, "range:output"))


@pytest.mark.parametrize(
    ("name", "vary", "sine"),
    [
        # sine of the angle between rod and rocker, and between rod and slide, from the solved points
        ("four_bar", {"crank": [0.029, 0.035], "ground": [0.1, 0.1]}, lambda p, d: _between(p, d["ground"])),
        ("slider_crank", {"crank": [0.03, 0.04]}, lambda p, d: abs((p["B"] - p["A"])[:, 0]) / d["rod"]),
    ],
)
def test_transmission_angles_of_many_designs_follow_from_their_points(name, vary, sine):
    count = len(next(iter(vary.values())))
    result = ms.sweep(name, design=vary, measure=["min:transmission"])
    for i in range(count):
        own = ms.catalog.make(name, **{key: values[i] for key, values in vary.items()})
        dimensions = own.parameters
        expected = np.arcsin(sine(own.positions(ANGLES), dimensions)).min()
        assert float(result["min:transmission"][i]) == pytest.approx(expected, abs=1e-12)


def _between(points, ground):
    rod, rocker = points["B"] - points["A"], points["B"] - [ground, 0.0, 0.0]
    return abs(np.cross(rod, rocker)[:, 2]) / np.linalg.norm(rod, axis=1) / np.linalg.norm(rocker, axis=1)


@pytest.mark.parametrize(("name", "parameter"), [("looper", "frame_angle"), ("bennett", "twist0")])
def test_measures_of_loop_equations_for_many_designs_include_transmission_angles(name, parameter):
    nominal = getattr(ms.catalog.make(name), parameter)
    vary = {parameter: [nominal, nominal + 1e-3]}
    result = ms.sweep(name, vary, ["min:transmission"])
    for i, value in enumerate(vary[parameter]):
        expected = ms.catalog.make(name, **{parameter: value}).transmission_angle(ANGLES).min()
        assert float(result["min:transmission"][i]) == pytest.approx(expected, abs=1e-11)
