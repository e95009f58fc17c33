"""A tolerance of a free crank is satisfied by estimates without a closed form."""

import numpy as np
import pytest
from grids import grid

from mechsim import catalog, dynamics
from mechsim.errors import InputError
from mechsim.model.forces import Forces, Friction
from mechsim.model.motors import TorqueSpeedLine
from mechsim.studies.dynamics_check import crosscheck_free

GRAVITY = (0.3, -9.81, 0.5)


def dynamic_model_of(name, **forces):
    return dynamics.dynamic_model(catalog.make(name), Forces(gravity=GRAVITY, **forces))


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
    model = dynamic_model_of("four_bar")
    run = dynamics.free_run(model, speed=1.0, duration=0.01, samples=2)
    for wrong in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="tolerance of a free run is"):
            crosscheck_free(run, model, tolerance=wrong)
