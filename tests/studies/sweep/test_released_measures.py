"""Measures of vibrations and runs from an initial state over designs, against closed solutions."""

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.errors import InputError

# a block on a spring and a damper along x; 2 kg and 200 N/m give 10 rad/s
OSCILLATOR = model_text("released_measures_oscillator.toml")
START = {"s.q": 0.05}


@pytest.fixture
def oscillator(tmp_path):
    path = tmp_path / "oscillator.toml"
    path.write_text(OSCILLATOR)
    return str(path)


def test_frequency_and_damping_ratio_of_an_oscillator_are_exact(oscillator):
    stiffness = np.array([100.0, 200.0, 400.0])
    table = ms.sweep(oscillator, {"stiffness": stiffness}, ["frequency:1", "damping_ratio:1"])
    natural = np.sqrt(stiffness / 2.0)
    np.testing.assert_allclose(table["frequency:1"], natural / (2.0 * np.pi), rtol=1e-10)
    np.testing.assert_allclose(table["damping_ratio:1"], 8.0 / (4.0 * natural), rtol=1e-9)
    assert table["frequency:1"].attrs["units"] == "Hz"


def test_settling_time_and_peaks_of_an_oscillator_are_exact(oscillator):
    measures = ["settling:P.x", "peak:s.v", "peak:kinetic", "peak:expr:P.x - 0.1"]
    table = ms.sweep(
        oscillator, {"viscous": np.array([8.0, 16.0])}, measures, initial=START, duration="4s", samples=500
    )
    for i, ratio in enumerate((0.2, 0.4)):
        time = np.linspace(0.0, 4.0, 500_001)
        damped = 10.0 * np.sqrt(1.0 - ratio**2)
        decay = 0.05 * np.exp(-10.0 * ratio * time)
        value = decay * (np.cos(damped * time) + 10.0 * ratio / damped * np.sin(damped * time))
        rate = -decay * 100.0 / damped * np.sin(damped * time)
        outside = np.abs(value) > 0.02 * np.ptp(value)
        settling_time = time[np.flatnonzero(outside)[-1]]
        # within the interval between the instants of the run
        assert table["settling:P.x"][i] == pytest.approx(settling_time, abs=4.0 / 500)
        assert table["peak:s.v"][i] == pytest.approx(np.abs(rate).max(), rel=1e-3)
        assert table["peak:kinetic"][i] == pytest.approx((rate**2).max(), rel=2e-3)
        assert table["peak:expr:P.x - 0.1"][i] == pytest.approx(0.05, rel=1e-12)


@pytest.mark.slow
def test_the_peak_of_a_joint_force_equals_that_of_the_run():
    start = {"crank.q": "-85deg"}
    measures = ["peak:force:A", "range:rocker"]
    table = ms.sweep("four_bar", {"crank": [0.03]}, measures, initial=start, duration="0.3s", samples=36)
    model = ms.dynamics.dynamic_model(ms.load("four_bar", {"crank": 0.03}), ms.Forces(gravity=(0, -9.81, 0)))
    run = ms.dynamics.run(model, initial=start, duration=0.3, samples=500)
    state = run.motion.angle, run.motion.speed, run.motion.acceleration
    forces = ms.dynamics.prescribed(model, *state, time=run.time).forces
    assert np.abs(forces.torque).max() < 1e-10
    largest = np.linalg.norm(forces.reactions["A"].force, axis=1).max()
    assert table["peak:force:A"][0] == pytest.approx(largest, rel=1e-9)
    # over the whole turn, as without a run
    assert (
        table["range:rocker"][0]
        == ms.sweep("four_bar", {"crank": [0.03]}, "range:rocker", samples=36)["range:rocker"][0]
    )


def test_an_unsettled_run_and_a_missing_mode_are_outcomes(oscillator):
    table = ms.sweep(oscillator, {"viscous": [1.0]}, "settling:s", initial=START, duration="1s")
    assert "s does not settle within 1 s" in str(table["reason"].values)
    table = ms.sweep(oscillator, {"viscous": [1.0]}, "frequency:2")
    assert "there is no mode 2; the highest is 1" in str(table["reason"].values)


@pytest.mark.parametrize(
    ("measure", "options", "message"),
    [
        ("frequency:0", {}, "has no mode number"),
        ("frequency:x", {}, "has no mode number"),
        ("peak:Z.x", {}, "has no quantity 'Z.x'"),
        ("range:s", {"initial": START}, "an initial state or event needs a measure"),
    ],
)
def test_invalid_measures_of_a_run_are_rejected(oscillator, measure, options, message):
    with pytest.raises(InputError, match=message):
        ms.sweep(oscillator, {"viscous": [1.0]}, measure, **options)
