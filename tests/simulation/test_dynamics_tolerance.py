"""A tolerance of torque, or of a free crank, is kept, by estimates that know no closed form."""

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


def of(name, **forces):
    return dynamics.dynamic_model(catalog.make(name), Forces(gravity=GRAVITY, **forces))


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
@pytest.mark.parametrize("name", ["rssr", "warp_knitter"])
def test_torque_and_reactions_are_kept_within_the_tolerance_and_the_estimate_is_the_true_error(
    name, tolerance
):
    machine = of(name)
    run = driven(machine.mechanism, machine.forces, speed=60.0, turns=2.0, tolerance=tolerance)
    exact = dynamics.prescribed(machine, run.motion.angle, run.motion.speed, run.motion.acceleration)
    true = np.abs(run.forces.torque - exact.forces.torque).max() / np.sqrt(np.mean(exact.forces.torque**2))
    assert run.outcome == "passed"
    assert true <= tolerance
    assert run.tolerance_report.estimates["torque"] == pytest.approx(true, rel=1e-3)
    # halving measures the same error by another way
    assert 0.1 < run.tolerance_report.estimates["halving"] / true < 10.0
    assert crosscheck_driven(run, machine).passed


@pytest.mark.slow
def test_a_tolerance_of_rounding_is_missed_with_a_reason_and_kept_by_poses():
    machine = of("warp_knitter")
    run = driven(machine.mechanism, machine.forces, speed=60.0, tolerance=1e-13)
    assert run.outcome == "failed"
    assert "are no better than fewer" in run.tolerance_report.reason
    assert crosscheck_driven(run, machine).outcome == "failed"
    poses = driven(machine.mechanism, machine.forces, speed=60.0, tolerance=1e-8, method="pose")
    assert poses.outcome == "passed"
    assert 0.0 < poses.tolerance_report.estimates["balance"] <= 1e-8


def test_a_crank_that_swings_keeps_its_tolerance_too():
    machine = of("four_bar", friction=(Friction("rocker", 1e-3, 1e-2),))
    profile = swing(machine.mechanism.start + 0.3, 0.5, 30.0)
    run = driven(machine.mechanism, machine.forces, profile=profile, tolerance=1e-5)
    assert run.outcome == "passed"
    assert crosscheck_driven(run, machine).passed


def test_each_of_the_two_estimates_sees_an_error_that_is_there(monkeypatch):
    machine = of("rssr")

    def asked():
        return driven(machine.mechanism, machine.forces, speed=60.0, tolerance=1e-6).tolerance_report

    monkeypatch.setattr(torque_tolerance, "against_poses", lambda *_: (1e-9, 1e-9))
    monkeypatch.setattr(torque_tolerance, "plausible_order", lambda *_: 4.0)
    # poses that claim all is well let too few steps through, halving does not
    assert asked().estimates["halving"] <= 1e-6
    monkeypatch.setattr(tolerance, "MAX_STEPS", torque_tolerance.EVEN)
    blind = asked()
    assert not blind.satisfied
    assert blind.estimates["halving"] > 1e-6


def test_only_forces_that_the_loops_settle_are_compared():
    known = determined_components(loaded_model(catalog.make("four_bar").mechanism, Forces()))
    assert known["crank"].tolist() == [True, True, False, False, False, True]
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
        ("bennett", "slider_crank"),
    ),
)
def test_a_free_crank_keeps_its_tolerance(name, tolerance):
    motor = TorqueSpeedLine(0.5, 100.0)
    machine = of(name, motor=motor, friction=(Friction("crank", 1e-4),), flywheel=1e-3)
    run = dynamics.free_run(machine, speed=20.0, turns=1.0, samples=61)
    verdict = crosscheck_free(run, machine, tolerance=tolerance)
    assert verdict.passed, verdict
    angles = [
        check for check in verdict.checks if check.kind.startswith("coordinate") and check.unit == "rad"
    ]
    assert angles
    assert all(check.worst <= check.tolerance <= tolerance for check in angles)


def test_a_tolerance_of_rounding_is_missed_with_a_reason_in_a_free_run():
    machine = of("four_bar")
    run = dynamics.free_run(machine, speed=30.0, duration=0.01, samples=3)
    verdict = crosscheck_free(run, machine, tolerance=1e-16)
    assert verdict.outcome == "failed"
    assert "do not reach the tolerance of 1e-16 rad" in verdict.reason


def test_what_cannot_be_kept_is_bad_input():
    mechanism, machine = catalog.make("four_bar").mechanism, of("four_bar")
    run = dynamics.free_run(machine, speed=1.0, duration=0.01, samples=2)
    for wrong in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="tolerance of torque is"):
            driven(mechanism, speed=1.0, tolerance=wrong)
        with pytest.raises(InputError, match="tolerance of a free run is"):
            crosscheck_free(run, machine, tolerance=wrong)


def test_settings_given_are_kept_but_for_their_number_of_steps():
    machine = of("rssr")
    given = Settings(compliance=1e-6)
    run = driven(machine.mechanism, machine.forces, speed=60.0, tolerance=1e-4, settings=given)
    assert replace(run.settings, steps_per_turn=given.steps_per_turn) == given
