"""Friction with bristles (LuGre) against scipy's integration of its equations, and in MuJoCo."""

import numpy as np
import pytest
from model_files import model_text
from scipy.integrate import solve_ivp

import mechsim as ms
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
    return ms.load(str(folder / "block.toml"), still=True)


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


@pytest.mark.long
def test_bristles_bring_a_small_motion_to_rest_in_c():
    """Errors relative to a creep of 0.4 mrad are near rounding, which shorter steps would not reduce.

    At rest the bristles hold the weight, by virtual work: k sum of z_i dq_i = -dV.
    """
    names = ("crank", "crank2", "A")
    rows = tuple(
        ms.Friction(name, coulomb=1e-3, bristle_stiffness=1.0, bristle_damping=1e-3) for name in names
    )
    model = dynamic_model(ms.load("warp_knitter"), ms.Forces(gravity=(0.0, -9.81, 0.0), friction=rows))
    run = ms.dynamics.run(model, duration=0.3, samples=900)
    assert (run.outcome, run.executed) == ("done", "C")
    assert run.energy_error <= 1e-10
    values = [run.motion.joints[name].value for name in names]
    along = (values[0] - values[0][-1]) / np.ptp(values[0])

    def derivative(course):
        return np.polyfit(along, course - course[-1], 3)[-2]

    carried = sum(z[-1] * derivative(value) for z, value in zip(run.activation, values, strict=True))
    assert abs(carried + derivative(run.potential)) <= 1e-5 * abs(carried)
