"""The forces of a file act in every Python call that is given what `ms.load` returns."""

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.simulation.dynamics.prescribed_motion import driven

# a slider pushed along x by 500 N: the inertia of the links is negligible
PRESS = model_text("forces_of_a_file_press.toml")
SPEED, ANGLES = 1.0, np.array([0.7, 1.5, 2.6])


@pytest.fixture
def press(file):
    return file(PRESS)


def torque_by_virtual_power(angle):
    """Return the crank torque that holds 500 N on the slider, from the slider's rate by the crank angle."""
    sine, cosine = np.sin(angle), np.cos(angle)
    return -500.0 * (0.03 * sine + 0.03**2 * sine * cosine / np.sqrt(0.09**2 - (0.03 * sine) ** 2))


def test_forces_of_a_file_act_in_inverse_dynamics(press):
    study = ms.dynamics.prescribed(ms.dynamics.dynamic_model(ms.load(press)), ANGLES, SPEED)
    # the links' inertia at 1 rad/s takes less than 1e-5 N m
    np.testing.assert_allclose(study.forces.torque, torque_by_virtual_power(ANGLES), atol=1e-5)


def test_explicit_forces_replace_those_of_a_file(press):
    free = ms.dynamics.prescribed(ms.dynamics.dynamic_model(ms.load(press), ms.Forces()), ANGLES, SPEED)
    assert np.abs(free.forces.torque).max() < 1e-5


def test_forces_of_a_file_act_in_dynamics_by_simulation(press):
    solver = ms.load(press)
    run = driven(solver, speed=SPEED, samples=12)
    np.testing.assert_allclose(run.forces.torque, torque_by_virtual_power(run.forces.angle), atol=1e-5)
    free = driven(solver, ms.Forces(), speed=SPEED, samples=12)
    assert np.abs(free.forces.torque).max() < 1e-5


def test_forces_of_a_file_act_in_sensitivities_sweeps_and_validation(press):
    solver = ms.load(press)
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
def test_a_rest_length_that_fits_in_metres_only_is_questioned(rest, is_questioned, tmp_path):
    # a block on a slide has the size 1 m
    path = tmp_path / "block.toml"
    path.write_text(model_text("forces_of_a_file_block.toml", rest=rest))
    facts = ms.load(str(path), still=True).facts
    assert any("'0.36 m'" in fact for fact in facts) == is_questioned
