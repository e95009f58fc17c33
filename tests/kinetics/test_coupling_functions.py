"""Couplings by an expression or a table, and belts, against closed forms and an independent integration."""

import numpy as np
import pytest
from model_files import model_text
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.kinetics import dynamic_model, prescribed
from mechsim.simulation.dynamics.prescribed_motion import driven

# about the pins: 2e-4 + 0.2 * 0.01 and 2e-4 + 0.3 * 0.0025 kg m2
FIRST, SECOND, ARM, GRAVITY = 2e-4 + 0.2 * 0.1**2, 2e-4 + 0.3 * 0.05**2, (0.2 * 0.1, 0.3 * 0.05), 9.81
MODEL = model_text("coupling_functions_model.toml")
WRITTEN = MODEL + 'function = "0.3*sin(3*q) + k*q"\n'


def load(folder, text, **options):
    path = folder / "model.toml"
    path.write_text(text)
    return ms.load(str(path), **options)


def law(q):
    return 0.3 * np.sin(3 * q) + 0.1 * q, 0.9 * np.cos(3 * q) + 0.1, -2.7 * np.sin(3 * q)


@pytest.mark.long
def test_an_expression_gives_motion_and_torque_of_its_closed_form(tmp_path):
    model, speed = load(tmp_path, WRITTEN), 3.0
    angles = np.linspace(0.1, 9.0, 23)
    motion, (value, rate, second) = model.solve(angles, speed=speed).joints["out"], law(angles)
    for own, exact in zip(
        (motion.value, motion.rate, motion.acceleration),
        (value, rate * speed, second * speed**2),
        strict=True,
    ):
        assert np.abs(own - exact).max() < 1e-13 * np.abs(exact).max()
    needed = GRAVITY * ARM[0] * np.cos(angles)
    needed += rate * (SECOND * second * speed**2 + GRAVITY * ARM[1] * np.cos(value))
    torque = prescribed(dynamic_model(model), angles, speed, 0.0).forces.torque
    assert np.abs(torque - needed).max() < 1e-13
    by_mujoco = driven(model, speed=speed, turns=1, method="pose").forces
    own = prescribed(dynamic_model(model), by_mujoco.angle, speed, 0.0).forces.torque
    assert np.abs(by_mujoco.torque - own).max() < 1e-12
    assert ms.validate(model).passed


@pytest.mark.long
def test_a_free_run_through_a_function_follows_an_independent_integration(tmp_path):
    model = load(tmp_path, WRITTEN, still=True)
    run = ms.dynamics.run(model, initial={"in.q": 0.4}, duration=1.0, tolerance=1e-13)

    def rates(_, state):
        q, v = state
        value, rate, second = law(q)
        moment = -GRAVITY * ARM[0] * np.cos(q) - rate * (GRAVITY * ARM[1] * np.cos(value))
        return [v, (moment - SECOND * rate * second * v**2) / (FIRST + SECOND * rate**2)]

    exact = solve_ivp(rates, (0.0, 1.0), [0.4, 0.0], "DOP853", rtol=1e-13, atol=1e-14).y[0, -1]
    assert abs(run.motion.joints["in"].value[-1] - exact) < 1e-10
    assert abs(run.motion.joints["out"].value[-1] - law(exact)[0]) < 1e-10


@pytest.mark.long
def test_a_table_is_a_cubic_spline_that_advances_by_its_period(tmp_path):
    q = np.linspace(0.0, 2 * np.pi, 65)
    rows = "\n".join(f"{a!r},{b!r}" for a, b in zip(q.tolist(), (q + 0.2 * np.sin(q)).tolist(), strict=True))
    (tmp_path / "law.csv").write_text(f"q,value\n{rows}\n")
    model = load(tmp_path, MODEL + 'function = "law.csv"\nperiodic = true\n')
    angles = np.linspace(-3.0, 20.0, 200)
    own = model.solve(angles, speed=1.0).joints["out"]
    # error of a cubic spline: 5/384 h^4 max f'''' (de Boor, ch. 5)
    assert np.abs(own.value - angles - 0.2 * np.sin(angles)).max() < 5 / 384 * (q[1] ** 4) * 0.2
    at_knots = model.solve(q[3:20] + 2 * np.pi, speed=1.0).joints["out"].value
    assert np.abs(at_knots - (2 * np.pi + q + 0.2 * np.sin(q))[3:20]).max() < 1e-14
    assert ms.validate(model).passed


@pytest.mark.parametrize(("crossed", "sign"), [("false", 1.0), ("true", -1.0)])
def test_a_belt_has_the_ratio_of_its_radii(tmp_path, crossed, sign):
    model = load(tmp_path, MODEL + f'radii = ["40 mm", "25 mm"]\ncrossed = {crossed}\n')
    own = model.solve(np.linspace(0.0, 20.0, 9), speed=2.0).joints["out"]
    assert np.abs(own.value - sign * 1.6 * np.linspace(0.0, 20.0, 9)).max() < 1e-13
    assert np.abs(own.rate - sign * 3.2).max() < 1e-14
    assert ms.validate(model).passed


@pytest.mark.long
def test_a_motion_beyond_the_table_ends_with_an_outcome(tmp_path):
    rows = "\n".join(f"{q},{0.5 * q}" for q in np.linspace(-1.0, 1.0, 9))
    (tmp_path / "t.csv").write_text(f"q,value\n{rows}\n")
    model = load(tmp_path, MODEL + 'function = "t.csv"\n')
    assert np.abs(model.solve([0.0, 0.9]).joints["out"].value - [0.0, 0.45]).max() < 1e-14
    with pytest.raises(ms.AssemblyError, match="cannot pass 1 rad"):
        model.solve([0.0, 1.5])
    # released upright it falls beyond the table
    free = load(tmp_path, MODEL.replace('drivers = ["in"]', "") + 'function = "t.csv"\n', still=True)
    run = ms.dynamics.run(free, initial={"in.q": 0.5, "in.v": 5.0}, duration=1.0)
    assert run.outcome not in ("done", "stopped")
    assert run.motion.joints["in"].value.max() <= 1.0 + 1e-9
