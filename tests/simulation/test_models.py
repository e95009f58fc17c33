"""The files in models/ equal the generated models and run in plain MuJoCo."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import mechsim as ms
from mechsim.simulation.source import assembled

MODELS = Path(__file__).parents[2] / "models"


@pytest.mark.parametrize("name", ms.catalog.MECHANISMS)
def test_the_model_file_equals_the_generated_model(name: str) -> None:
    text = (MODELS / f"{name}.xml").read_text()
    written = mujoco.MjModel.from_xml_string(text)
    made = assembled(ms.catalog.make(name).mechanism, ms.Scene()).compile()
    assert [made.body(i).name for i in range(made.nbody)] == [
        written.body(i).name for i in range(written.nbody)
    ]
    for field in (
        "body_pos",
        "body_quat",
        "jnt_pos",
        "jnt_axis",
        "qpos0",
        "site_pos",
        "eq_data",
        "body_inertia",
    ):
        # assembly ends at rounding, which may differ by a few ulp from one processor to the next
        np.testing.assert_allclose(getattr(written, field), getattr(made, field), rtol=1e-12, atol=1e-15)


def test_the_solver_tolerance_of_a_model_keeps_full_accuracy() -> None:
    def state(tolerance: float | None) -> np.ndarray:
        model = mujoco.MjModel.from_xml_path(str(MODELS / "four_bar.xml"))
        assert (
            0.0
            < model.opt.tolerance
            == assembled(ms.catalog.make("four_bar").mechanism, ms.Scene()).option.tolerance
        )
        model.opt.tolerance = model.opt.tolerance if tolerance is None else tolerance
        data = mujoco.MjData(model)
        data.joint("crank").qvel[0] = 20.0 * np.pi
        mujoco.mj_step(model, data, 200)
        return data.qpos

    exact = state(0.0)
    assert np.abs(state(None) - exact).max() < 1e-12
    assert np.abs(state(1e-8) - exact).max() > 1e-8
