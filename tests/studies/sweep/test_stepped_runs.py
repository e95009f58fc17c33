"""Stepped sweeps: batched against single designs, outcomes, rejected input and the check."""

import numpy as np
import pytest

import mechsim as ms
from mechsim.errors import InputError
from mechsim.simulation import Settings
from mechsim.studies.sweep.sweeping import check_sweep, run_sweep, swept_task
from mechsim.studies.sweep.task import SweepTask

FEW_STEPS = Settings(steps_per_turn=60)
OPTIONS = {"settings": FEW_STEPS, "speed": 40.0, "samples": 30}


def test_batched_stepped_designs_have_the_measures_of_single_ones(monkeypatch):
    measures = ["range:output", "max:D.ax", "stroke:D", "rms:output.v", "at:24deg:D.x"]
    batched = ms.sweep("watt_six_bar", {"crank": [0.02, 0.03]}, measures, **OPTIONS)
    monkeypatch.setattr(SweepTask, "like", None)
    single = ms.sweep("watt_six_bar", {"crank": [0.02, 0.03]}, measures, **OPTIONS)
    assert batched["outcome"].values.tolist() == ["passed", "passed"]
    for name in measures:
        # accelerations are those of soft constraints, which magnify rounding
        tolerance = 1e-9 if ".a" in name else 1e-12
        np.testing.assert_allclose(batched[name], single[name], rtol=tolerance, err_msg=name)


def test_a_stepped_sweep_approximates_that_of_formulas():
    vary, measures = {"crank": [0.02, 0.03]}, ["range:rocker", "max:C.vx"]
    stepped = ms.sweep("four_bar", vary, measures, settings=FEW_STEPS, speed=40.0)
    exact = ms.sweep("four_bar", vary, measures, samples=60, speed=40.0)
    for name in measures:
        np.testing.assert_allclose(stepped[name], exact[name], rtol=1e-4)
        assert (stepped[name].values != exact[name].values).all()


def test_torques_of_stepped_designs_approximate_those_of_formulas(monkeypatch):
    options = {"settings": Settings(steps_per_turn=200), "speed": 40.0, "samples": 50}
    batched = ms.sweep("four_bar", {"crank": [0.02, 0.03]}, "max:torque", **options)["max:torque"]
    monkeypatch.setattr(SweepTask, "like", None)
    single = ms.sweep("four_bar", {"crank": [0.02, 0.03]}, "max:torque", **options)["max:torque"]
    # the same constraint forces with a rounding error of 1e-10
    np.testing.assert_allclose(batched, single, rtol=1e-8)
    exact = ms.sweep("four_bar", {"crank": [0.02, 0.03]}, "max:torque", samples=50, speed=40.0)["max:torque"]
    np.testing.assert_allclose(batched, exact, rtol=1e-4)


def test_measures_of_forces_step_designs_one_by_one():
    for model, measure in (("rssr", "max:torque"), ("four_bar", "max:force:A"), ("four_bar", "max:C.vx")):
        task = swept_task(model, {"crank": [0.013]}, [measure, "max:torque"], settings=FEW_STEPS)
        assert task.like is None
    assert swept_task("rssr", {"crank": [0.013]}, "max:P3.vx", settings=FEW_STEPS).like is not None


def test_stepped_designs_report_their_outcomes():
    designs = {"crank": [0.02, 0.045, 0.08, -1.0]}
    result = ms.sweep("four_bar", designs, "range:rocker", settings=Settings(steps_per_turn=8), speed=40.0)
    assert result["outcome"].values.tolist() == ["failed", "failed", "diverged", "cannot assemble"]
    assert "from the solved poses (tolerance" in str(result["reason"].values[0])
    assert np.isfinite(result["range:rocker"].values[:2]).all()
    assert np.isnan(result["range:rocker"].values[2:]).all()
    hard = Settings(steps_per_turn=8, solref=(-1e12, -1e3))
    result = ms.sweep("four_bar", {"crank": [0.02]}, "range:rocker", settings=hard, speed=40.0)
    assert result["outcome"].values.tolist() == ["diverged"]


@pytest.mark.parametrize(
    ("measure", "printed"),
    [
        ("crank_range", "crank_range needs formulas"),
        ("max:transmission", "leave out --method step"),
        ("range:B", "stepped motions contain crank, A, rocker"),
        ("at:10deg:rocker", "no instant is recorded at"),
    ],
)
def test_measures_unavailable_in_stepped_motions_are_rejected(measure, printed):
    with pytest.raises(InputError, match=printed):
        swept_task("four_bar", {"crank": [0.03]}, measure, settings=FEW_STEPS, samples=30)


@pytest.mark.long
def test_the_check_rejects_a_wrong_table():
    for task_options in (OPTIONS, {"samples": 12}):
        task = swept_task("watt_six_bar", {"crank": [0.02, 0.03]}, "range:output", **task_options)
        result = run_sweep(task)
        assert check_sweep(task, result, 2).passed == 2
        result["range:output"].values[1] *= 1.0 + 1e-6
        checked = check_sweep(task, result, 2)
        assert checked.passed == 1
        assert "in the table and" in checked.failed[1]


def test_settings_distinguish_stepped_sweeps(tmp_path):
    out = tmp_path / "out.nc"
    ms.sweep("four_bar", {"crank": [0.03]}, "range:rocker", output=out, **OPTIONS)
    for other in ({}, {"settings": Settings(steps_per_turn=60, integrator="Euler")}):
        with pytest.raises(InputError, match="another sweep"):
            ms.sweep(
                "four_bar",
                {"crank": [0.03]},
                "range:rocker",
                output=out,
                **{**OPTIONS, "settings": None, **other},
            )


def test_the_default_compliance_depends_on_the_measure():
    """`mechsim sweep --method step` passes its settings unchanged."""

    def compliance(model, vary, measure, **task_options):
        return swept_task(model, vary, measure, settings=Settings(**task_options)).settings.compliance

    forces = ("rack_steering", {"radius": [0.005]}, "max:torque")
    assert compliance(*forces) == 1e-12
    assert compliance(*forces, compliance=1e-8) == 1e-8
    # batched designs and measures without forces use the compliance for positions
    assert compliance("four_bar", {"crank": [0.03]}, "max:torque") is None
    assert compliance("rack_steering", {"radius": [0.005]}, "range:rack") is None
    assert Settings().compliance_used == 1e-8
