"""Friction with bristles (LuGre) against scipy's integration of its equations, and in MuJoCo."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mechsim as ms
from mechsim.analytic.dynamics import dynamic_model
from mechsim.analytic.dynamics.dynamic_run import initial_values
from mechsim.errors import InputError
from mechsim.studies.dynamics_check import crosscheck_forward
from mechsim.subjects.readers import load
from mechsim.subjects.toml_writer import to_toml

BLOCK = """name = "block"
[joints.slide]
kind = "prismatic"
a = { link = "ground", axis = [1, 0, 0] }
b = { link = "block", axis = [1, 0, 0] }
[joints.slide.friction]
coulomb = 1
static = 1.5
stribeck = 0.01
viscous = 0.4
bristle_stiffness = 1e4
bristle_damping = 100
[links.block]
inertia = { mass = 1.0, centre = [0, 0, 0], moments = [1e-3, 1e-3, 1e-3] }
[forces]
gravity = [0, -9.81, 0]
joint_springs.slide = { stiffness = 50, rest = 0.1 }
"""


def by_hand(_, state):
    x, v, z = state
    limit = 1.0 + 0.5 * np.exp(-((v / 0.01) ** 2))
    rate = v - 1e4 * abs(v) * z / limit
    return [v, 50.0 * (0.1 - x) - 1e4 * z - 100.0 * rate - 0.4 * v, rate]


SPRING = "joint_springs.slide = { stiffness = 50, rest = 0.1 }"


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
    assert crosscheck_forward(run, model, initial_values(model, {})).passed


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("bristle_stiffness = 1e4\n", "", "bristle damping in joint 'slide' has no effect"),
        ("coulomb = 1\nstatic = 1.5\nstribeck = 0.01\n", "", "give it with `coulomb`"),
        ("bristle_stiffness = 1e4", "bristle_stiffness = -1", "bristle stiffness of friction"),
        ("coulomb = 1\n", "coefficient = 0.1\n", "without a coefficient, in a revolute"),
    ],
)
def test_bristles_that_cannot_be_are_rejected(tmp_path, old, new, expected):
    with pytest.raises(InputError, match=expected):
        loaded(tmp_path, BLOCK.replace(SPRING, "").replace(old, new))


def test_bristles_are_written_again(tmp_path):
    assert "bristle_damping = 100" in to_toml(loaded(tmp_path))
