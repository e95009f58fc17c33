"""Couplings by an expression or a table, and belts, against closed forms and an independent integration."""

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.studies.robots.serial_twin import serial_twin

MODEL = model_text("coupling_functions_model.toml")


@pytest.mark.long
def test_a_table_is_a_cubic_spline_that_advances_by_its_period(file, tmp_path):
    q = np.linspace(0.0, 2 * np.pi, 65)
    rows = "\n".join(f"{a!r},{b!r}" for a, b in zip(q.tolist(), (q + 0.2 * np.sin(q)).tolist(), strict=True))
    (tmp_path / "law.csv").write_text(f"q,value\n{rows}\n")
    model = ms.load(file(MODEL + 'function = "law.csv"\nperiodic = true\n'))
    angles = np.linspace(-3.0, 20.0, 200)
    own = model.solve(angles, speed=1.0).joints["out"]
    # error of a cubic spline: 5/384 h^4 max f'''' (de Boor, ch. 5)
    assert np.abs(own.value - angles - 0.2 * np.sin(angles)).max() < 5 / 384 * (q[1] ** 4) * 0.2
    at_knots = model.solve(q[3:20] + 2 * np.pi, speed=1.0).joints["out"].value
    assert np.abs(at_knots - (2 * np.pi + q + 0.2 * np.sin(q))[3:20]).max() < 1e-14
    assert ms.validate(model).passed


@pytest.mark.long
def test_a_motion_beyond_the_table_ends_with_an_outcome(file, tmp_path):
    rows = "\n".join(f"{q},{0.5 * q}" for q in np.linspace(-1.0, 1.0, 9))
    (tmp_path / "t.csv").write_text(f"q,value\n{rows}\n")
    model = ms.load(file(MODEL + 'function = "t.csv"\n'))
    assert np.abs(model.solve([0.0, 0.9]).joints["out"].value - [0.0, 0.45]).max() < 1e-14
    with pytest.raises(ms.AssemblyError, match="cannot pass 1 rad"):
        model.solve([0.0, 1.5])
    # released upright it falls beyond the table
    free = ms.load(file(MODEL.replace('drivers = ["in"]', "") + 'function = "t.csv"\n'), still=True)
    run = ms.dynamics.run(free, initial={"in.q": 0.5, "in.v": 5.0}, duration=1.0)
    assert run.outcome not in ("done", "stopped")
    assert run.motion.joints["in"].value.max() <= 1.0 + 1e-9


def test_a_hoist_without_loops_couples_the_hook_to_the_drum_by_its_name():
    # in models of MuJoCo the crank has another name, which the terms of the rope must not keep
    twin = serial_twin("hoist", "urdf", independent={"drum": (-1.0, 1.0)})
    assert abs(float(twin.text.split('multiplier="')[1].split('"')[0]) - 0.025) < 1e-15
    states = ms.sample("hoist", 4)
    assert np.abs(states.qpos[:, 1] - 0.025 * states.qpos[:, 0]).max() < 1e-15
