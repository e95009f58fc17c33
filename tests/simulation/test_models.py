"""The files in models/ equal the generated models and run in plain MuJoCo."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import mechsim as ms
from mechsim.simulation.source import assembled

FIELDS = ("body_pos", "body_quat", "body_inertia", "jnt_pos", "jnt_axis", "qpos0", "site_pos", "eq_data")
MODELS = Path(__file__).parents[2] / "models"


@pytest.mark.parametrize("name", ms.catalog.MECHANISMS)
def test_the_model_file_equals_the_generated_model(name: str) -> None:
    written = mujoco.MjModel.from_xml_path(str(MODELS / f"{name}.xml"))
    made = assembled(ms.catalog.make(name).mechanism, ms.Scene()).compile()
    assert (made.names, made.opt.tolerance) == (written.names, written.opt.tolerance)
    for field in FIELDS:
        # assembly ends at rounding, which may differ by a few ulp from one processor to the next
        np.testing.assert_allclose(getattr(written, field), getattr(made, field), rtol=1e-12, atol=1e-15)


def stepped(**options: float) -> np.ndarray:
    """Return the state of the four-bar after 200 steps with options."""
    model = mujoco.MjModel.from_xml_path(str(MODELS / "four_bar.xml"))
    for name, value in options.items():
        setattr(model.opt, name, value)
    data = mujoco.MjData(model)
    data.joint("crank").qvel[0] = 20.0 * np.pi
    mujoco.mj_step(model, data, 200)
    return data.qpos


def test_the_solver_tolerance_of_a_model_keeps_full_accuracy() -> None:
    exact = stepped(tolerance=0.0)
    assert np.abs(stepped() - exact).max() < 1e-12
    assert np.abs(stepped(tolerance=1e-8) - exact).max() > 1e-8
