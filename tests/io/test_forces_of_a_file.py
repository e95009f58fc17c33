"""The forces of a file act in every Python call that is given what `ms.load` returns."""

import numpy as np
import pytest
from model_files import FOLDER, load_model

import mechsim as ms
from mechsim.simulation.dynamics.prescribed_motion import driven

# a slider pushed along x by 500 N: the inertia of the links is negligible
PRESS = FOLDER / "forces_of_a_file_press.toml"
SPEED, ANGLES = 1.0, np.array([0.7, 1.5, 2.6])


def torque_by_virtual_power(angle):
    """Return the crank torque that holds 500 N on the slider, from the slider's rate by the crank angle."""
    sine, cosine = np.sin(angle), np.cos(angle)
    return -500.0 * (0.03 * sine + 0.03**2 * sine * cosine / np.sqrt(0.09**2 - (0.03 * sine) ** 2))


def inverse(solver, *forces):
    return ms.dynamics.prescribed(ms.dynamics.dynamic_model(solver, *forces), ANGLES, SPEED)


def simulated(solver, *forces):
    return driven(solver, *forces, speed=SPEED, samples=12)


@pytest.mark.parametrize("method", [inverse, simulated])
def test_forces_of_a_file_act_unless_others_are_stated(method):
    result, free = method(ms.load(PRESS)).forces, method(ms.load(PRESS), ms.Forces()).forces
    # the links' inertia at 1 rad/s takes less than 1e-5 N m
    np.testing.assert_allclose(result.torque, torque_by_virtual_power(result.angle), atol=1e-5)
    assert np.abs(free.torque).max() < 1e-5


def test_forces_of_a_file_act_in_sensitivities_sweeps_and_validation():
    solver = ms.load(PRESS)
    exact = torque_by_virtual_power(ANGLES)
    result = dict(ms.sensitivity(solver, "torque", "A.at.x", angles=ANGLES, speed=SPEED).values)
    np.testing.assert_allclose(result["torque"], exact, atol=1e-5)
    largest = ms.sweep(solver, {"A.at.x": [0.0]}, "at:1.5:torque", speed=SPEED)
    np.testing.assert_allclose(largest["at:1.5:torque"].values, exact[1], atol=1e-5)
    agrees = ms.validate(
        solver, lambda angle: {"torque:crank": torque_by_virtual_power(angle)}, speed=SPEED, tolerance=1e-4
    )
    assert agrees.passed, agrees


@pytest.mark.parametrize(
    ("rest", "is_questioned"), [("0.36", True), ("360", False), ("'0.36 mm'", False), ("0", False)]
)
def test_a_rest_length_that_fits_in_metres_only_is_questioned(rest, is_questioned):
    # a block on a slide has the size 1 m
    facts = load_model("forces_of_a_file_block.toml", rest=rest, still=True).facts
    assert any("'0.36 m'" in fact for fact in facts) == is_questioned
