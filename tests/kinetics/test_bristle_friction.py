"""Friction with bristles (LuGre) against scipy's integration of its equations, and in MuJoCo."""

import numpy as np
import pytest
from model_files import model_text
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.io.readers import load
from mechsim.io.toml_writer import to_toml
from mechsim.kinetics import dynamic_model
from mechsim.kinetics.dynamic_run import initial_values
from mechsim.studies.dynamics_check import crosscheck_forward

BLOCK = model_text("bristle_friction_block.toml")


def by_hand(_, state):
    x, v, z = state
    limit = 1.0 + 0.5 * np.exp(-((v / 0.01) ** 2))
    rate = v - 1e4 * abs(v) * z / limit
    return [v, 50.0 * (0.1 - x) - 1e4 * z - 100.0 * rate - 0.4 * v, rate]


def loaded(folder, text=BLOCK):
    (folder / "block.toml").write_text(text)
    return load(str(folder / "block.toml"), still=True)


@pytest.mark.long
def test_a_block_on_bristles_moves_as_by_scipy_and_in_mujoco(tmp_path):
    model = dynamic_model(loaded(tmp_path))
    run = ms.dynamics.run(model, duration=0.08, samples=8)
    # short steps: between long ones scipy interpolates with errors of 1e-9
    options = {"rtol": 1e-12, "atol": 1e-14, "max_step": 5e-5}
    exact = solve_ivp(by_hand, (0.0, 0.08), np.zeros(3), "DOP853", run.time, **options)
    slide = run.motion.joints["slide"]
    assert np.abs(slide.value - exact.y[0]).max() <= 1e-10
    assert np.abs(slide.rate - exact.y[1]).max() <= 1e-11
    assert np.abs(run.activation[0] - exact.y[2]).max() <= 1e-11
    assert run.energy_error <= 1e-11
    assert (run.executed, run.note) == ("C", "")
    assert crosscheck_forward(run, model, initial_values(model, {})).passed


def test_bristles_are_written_again(tmp_path):
    assert "bristle_damping = 100" in to_toml(loaded(tmp_path))
