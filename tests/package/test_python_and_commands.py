"""Functions give the results of the commands of the same name for any kind of model."""

import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
from grids import grid

import mechsim as ms

ROOT = Path(__file__).parents[2]
SCENE = ROOT / "examples" / "own_model.xml"
# a mechanism as a name, a description, a solver and MuJoCo objects; a file
MODELS = {
    "name": lambda: "four_bar",
    "description": lambda: ms.load("four_bar").mechanism,
    "solver": lambda: ms.load("four_bar"),
    "file": lambda: SCENE,
    "text of a path": lambda: str(SCENE),
    "specification": lambda: mujoco.MjSpec.from_string(ms.export("four_bar").text),
    "model": lambda: mujoco.MjModel.from_xml_path(str(SCENE)),
}


@pytest.mark.long
@pytest.mark.parametrize("kind", grid(MODELS, ("name", "specification")))
@pytest.mark.parametrize(
    "call",
    [
        ms.load,
        lambda model: ms.simulate(model, speed="60rpm", turns=0.05),
        lambda model: ms.trace(model, starts=1),
        lambda model: ms.sample(model, 2),
        ms.check,
        lambda model: ms.view(model),
        lambda model: ms.export(model, format="toml"),
        lambda model: ms.dynamics.run(model, duration="10ms", samples=2),
    ],
    ids=["load", "simulate", "trace", "sample", "check", "view", "export", "run"],
)
def test_every_function_accepts_every_kind_of_model(call, kind):
    assert call(MODELS[kind]()) is not None


def test_coordinates_have_the_same_order_for_a_path_and_a_solver():
    expected = ms.sample(str(SCENE), 2).qpos
    for model in (SCENE, ms.load(SCENE, still=True)):
        np.testing.assert_allclose(ms.sample(model, 2).qpos, expected, rtol=0, atol=1e-12)


def test_function_and_command_export_equally(mechsim, tmp_path):
    arguments = ("--speed", "600rpm", "--timestep", "1ms", "--set", "crank=35mm")
    own = {"set": {"crank": "35mm"}, "speed": "600rpm", "timestep": "1ms"}
    exported = ms.export("four_bar", tmp_path / "a.xml", **own)
    assert exported.text == json.loads(mechsim("export", "four_bar", *arguments, "--json").out)["text"]
    assert (tmp_path / "a.xml").read_text() == exported.text
    assert mujoco.MjModel.from_xml_string(exported.text).opt.timestep == 0.001


def test_closed_configurations_accept_units():
    by_text = ms.closed_qpos("four_bar", {"crank": "30deg"})
    assert by_text == pytest.approx(ms.closed_qpos("four_bar", {"crank": np.pi / 6}), abs=0)
