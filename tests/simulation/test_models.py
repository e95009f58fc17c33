"""The files in models/ equal the generated models and run in plain MuJoCo."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mechsim import catalog
from mechsim.model.scene import Scene
from mechsim.simulation.source import assembled

MODELS = Path(__file__).parents[2] / "models"


def test_the_models_are_those_of_the_catalogue() -> None:
    assert {path.stem for path in MODELS.glob("*.xml")} == set(catalog.MECHANISMS)


@pytest.mark.parametrize("name", catalog.MECHANISMS)
def test_the_model_file_equals_the_generated_model(name: str) -> None:
    text = (MODELS / f"{name}.xml").read_text()
    written = mujoco.MjModel.from_xml_string(text)
    made = assembled(catalog.make(name).mechanism, Scene()).compile()
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


@pytest.mark.parametrize("name", catalog.MECHANISMS)
def test_plain_mujoco_reads_the_model_assembled_with_a_site_per_point(name: str) -> None:
    linkage = catalog.make(name)
    model = mujoco.MjModel.from_xml_path(str(MODELS / f"{name}.xml"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    angle = float(data.joint("crank").qpos[0])
    assert angle == 0.0
    for point, position in linkage.positions([angle]).items():
        # 1e-12 of the crank: assembly to rounding
        assert (
            np.abs(data.site(point).xpos - position[0]).max()
            <= 1e-12 * linkage.mechanism.characteristic_length
        )


def test_the_solver_tolerance_of_a_model_keeps_full_accuracy() -> None:
    def state(tolerance: float | None) -> np.ndarray:
        model = mujoco.MjModel.from_xml_path(str(MODELS / "four_bar.xml"))
        assert (
            0.0
            < model.opt.tolerance
            == assembled(catalog.make("four_bar").mechanism, Scene()).option.tolerance
        )
        model.opt.tolerance = model.opt.tolerance if tolerance is None else tolerance
        data = mujoco.MjData(model)
        data.joint("crank").qvel[0] = 20.0 * np.pi
        mujoco.mj_step(model, data, 200)
        return data.qpos

    exact = state(0.0)
    assert np.abs(state(None) - exact).max() < 1e-12
    assert np.abs(state(1e-8) - exact).max() > 1e-8


@pytest.mark.parametrize("name", catalog.MECHANISMS)
def test_plain_mujoco_steps_the_model_through_a_turn(name: str) -> None:
    linkage = catalog.make(name)
    model = mujoco.MjModel.from_xml_path(str(MODELS / f"{name}.xml"))
    data = mujoco.MjData(model)
    data.joint("crank").qvel[0] = 20.0 * np.pi
    # the constraints determine the rates of the other joints within the first steps
    mujoco.mj_step(model, data, nstep=1000)
    mujoco.mj_forward(model, data)
    angle = float(data.joint("crank").qpos[0])
    for point, position in linkage.positions([angle]).items():
        # MuJoCo's own compliance and a linkage at rest at the start; a wrong assembly mode is 100 times worse
        assert (
            np.linalg.norm(data.site(point).xpos - position[0])
            <= 5e-3 * linkage.mechanism.characteristic_length
        )
