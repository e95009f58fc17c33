"""A tolerance of torque, or of a free crank, is satisfied by estimates without a closed form."""

from dataclasses import replace

import numpy as np
import pytest
from grids import grid

from mechsim import catalog, dynamics
from mechsim.errors import InputError
from mechsim.model.forces import Forces, Friction
from mechsim.model.motors import TorqueSpeedLine
from mechsim.simulation import Settings, swing, tolerance
from mechsim.simulation.dynamics import torque_tolerance
from mechsim.simulation.dynamics.determinacy import determined_components
from mechsim.simulation.dynamics.loaded_model import loaded_model
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.studies.dynamics_check import crosscheck_driven, crosscheck_free

GRAVITY = (0.3, -9.81, 0.5)


def dynamic_model_of(name, **forces):
    return dynamics.dynamic_model(catalog.make(name), Forces(gravity=GRAVITY, **forces))


@pytest.mark.long
@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
@pytest.mark.parametrize("name", grid(["rssr", "warp_knitter"]))
def test_the_torque_estimate_is_the_true_error_within_the_tolerance(name, tolerance):
    model = dynamic_model_of(name)
    run = driven(model.mechanism, model.forces, speed=60.0, turns=2.0, tolerance=tolerance)
    exact = dynamics.prescribed(model, run.motion.angle, run.motion.speed, run.motion.acceleration)
    true = np.abs(run.forces.torque - exact.forces.torque).max() / np.sqrt(np.mean(exact.forces.torque**2))
    assert run.outcome == "passed"
    assert true <= tolerance
    assert run.tolerance_report.estimates["torque"] == pytest.approx(true, rel=1e-3)
    # step halving estimates the same error independently
    assert 0.1 < run.tolerance_report.estimates["halving"] / true < 10.0
    assert crosscheck_driven(run, model).passed


@pytest.mark.long
def test_a_swinging_crank_satisfies_its_tolerance():
    model = dynamic_model_of("four_bar", friction=(Friction("rocker", 1e-3, 1e-2),))
    profile = swing(model.mechanism.start + 0.3, 0.5, 30.0)
    run = driven(model.mechanism, model.forces, profile=profile, tolerance=1e-5)
    assert run.outcome == "passed"
    assert crosscheck_driven(run, model).passed


def test_step_halving_detects_an_error_hidden_from_the_pose_estimate(monkeypatch):
    model = dynamic_model_of("rssr")

    def report():
        return driven(model.mechanism, model.forces, speed=60.0, tolerance=1e-6).tolerance_report

    monkeypatch.setattr(torque_tolerance, "against_poses", lambda *_: (1e-9, 1e-9))
    monkeypatch.setattr(torque_tolerance, "plausible_order", lambda *_: 4.0)
    # with a pose estimate that reports no error, too few steps would be accepted; step halving prevents this
    assert report().estimates["halving"] <= 1e-6
    monkeypatch.setattr(tolerance, "MAX_STEPS", torque_tolerance.EVEN)
    underestimated = report()
    assert not underestimated.satisfied
    assert underestimated.estimates["halving"] > 1e-6


def test_only_statically_determined_forces_are_compared():
    determined = determined_components(loaded_model(catalog.make("four_bar").mechanism, Forces()))
    assert determined["crank"].tolist() == [True, True, False, False, False, True]
    assert all(
        item.all()
        for item in determined_components(loaded_model(catalog.make("rssr").mechanism, Forces())).values()
    )
    bennett = determined_components(loaded_model(catalog.make("bennett").mechanism, Forces()))
    assert not any(item.all() for item in bennett.values())


@pytest.mark.parametrize(
    ("name", "tolerance"),
    grid(
        [("four_bar", 1e-3), ("four_bar", 1e-9), ("bennett", 1e-4), ("slider_crank", 1e-7)],
        ("slider_crank",),
    ),
)
def test_a_free_crank_satisfies_its_tolerance(name, tolerance):
    motor = TorqueSpeedLine(0.5, 100.0)
    model = dynamic_model_of(name, motor=motor, friction=(Friction("crank", 1e-4),), flywheel=1e-3)
    run = dynamics.free_run(model, speed=20.0, turns=1.0, samples=61)
    verdict = crosscheck_free(run, model, tolerance=tolerance)
    assert verdict.passed, verdict
    angles = [
        check for check in verdict.checks if check.kind.startswith("coordinate") and check.unit == "rad"
    ]
    assert angles
    assert all(check.worst <= check.tolerance <= tolerance for check in angles)


def test_a_tolerance_below_rounding_fails_in_a_free_run():
    model = dynamic_model_of("four_bar")
    run = dynamics.free_run(model, speed=30.0, duration=0.01, samples=3)
    verdict = crosscheck_free(run, model, tolerance=1e-16)
    assert verdict.outcome == "failed"
    assert "do not reach the tolerance of 1e-16 rad" in verdict.reason


def test_invalid_tolerances_are_rejected():
    mechanism, model = catalog.make("four_bar").mechanism, dynamic_model_of("four_bar")
    run = dynamics.free_run(model, speed=1.0, duration=0.01, samples=2)
    for wrong in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="tolerance of torque is"):
            driven(mechanism, speed=1.0, tolerance=wrong)
        with pytest.raises(InputError, match="tolerance of a free run is"):
            crosscheck_free(run, model, tolerance=wrong)


def test_a_tolerance_changes_only_the_number_of_steps():
    model = dynamic_model_of("rssr")
    requested = Settings(compliance=1e-6)
    run = driven(model.mechanism, model.forces, speed=60.0, tolerance=1e-4, settings=requested)
    assert replace(run.settings, steps_per_turn=requested.steps_per_turn) == requested
