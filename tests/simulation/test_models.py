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
