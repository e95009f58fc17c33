"""Every kind of model is opened by a row of READERS; MuJoCo's objects and URDF are read like MJCF."""

import json
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pytest
from motions import largest_difference

import mechsim as ms
from mechsim.io import model_source
from mechsim.io.model_source import ModelDescription, ModelSource, Reader
from mechsim.kinematics.solvers import KinematicSolver

FOUR_BAR = Path(__file__).parents[2] / "models" / "four_bar.xml"
ANGLES = np.linspace(0.0, 2.0 * np.pi, 25)


@dataclass(frozen=True)
class LengthsFile(ModelSource):
    """A toy format: the four lengths of a four-bar linkage in JSON."""

    path: str

    def describe(self, changed, prescription):
        ground, crank, coupler, rocker = json.loads(Path(self.path).read_text())
        lengths = {"ground": ground, "crank": crank, "coupler": coupler, "rocker": rocker} | dict(changed)
        return ModelDescription(KinematicSolver(ms.catalog.make("four_bar", **lengths).mechanism))


@pytest.fixture
def toy(monkeypatch, tmp_path):
    """A file of a format that one row of READERS adds."""
    monkeypatch.setattr(
        model_source, "READERS", [*model_source.READERS, Reader(LengthsFile, suffixes=(".bars",))]
    )
    file = tmp_path / "linkage.bars"
    file.write_text("[0.1, 0.03, 0.09, 0.07]")
    return str(file)


def test_a_new_file_format_needs_one_reader(toy):
    model = ms.load(toy, track=["C"])
    exact = ms.catalog.make("four_bar", ground=0.1, crank=0.03, coupler=0.09, rocker=0.07).solve(ANGLES)
    difference = model.solve(ANGLES).points["C"].position - exact.points["C"].position
    assert np.abs(difference).max() <= 1e-14  # rounding of 0.1 m
    assert list(model.mechanism.points) == ["C"]


def test_mujoco_specs_and_models_have_the_motion_of_their_file():
    exact = ms.load(str(FOUR_BAR)).solve(ANGLES)
    spec = mujoco.MjSpec.from_file(str(FOUR_BAR))
    before = spec.to_xml()
    assert largest_difference(ms.load(spec).solve(ANGLES), exact) == 0.0
    assert spec.to_xml() == before
    assert (
        largest_difference(ms.load(mujoco.MjModel.from_xml_path(str(FOUR_BAR))).solve(ANGLES), exact) == 0.0
    )


def test_changes_of_a_mujoco_model_are_read():
    model = mujoco.MjModel.from_xml_path(str(FOUR_BAR))
    model.body("coupler").pos[0] = 0.0321234567890123
    joint = ms.load(model).mechanism.joint("A")
    assert joint.a.point[0] == 0.0321234567890123


def test_a_mujoco_model_that_was_not_loaded_last_is_rejected():
    model = mujoco.MjModel.from_xml_path(str(FOUR_BAR))
    mujoco.MjModel.from_xml_path(str(FOUR_BAR.with_name("rssr.xml")))
    with pytest.raises(ms.InputError, match=r"^MjModel 'four_bar' is not the model that MuJoCo loaded last"):
        ms.load(model)


FILE = """
import mechsim as ms
plain = ms.catalog.make("four_bar").mechanism
drive = ms.catalog.make("rssr", crank=0.014)
def made():
    return plain
def broken():
    raise ZeroDivisionError("no wonder\\nat all")
number = 3
int = int
largest = max
"""


@pytest.fixture
def path(tmp_path):
    (tmp_path / "own.py").write_text(FILE)
    return str(tmp_path / "own.py")


def test_mechanisms_and_functions_of_a_python_file_are_models(path):
    exact = ms.catalog.make("four_bar").positions([1.0])["B"]
    for name in ("plain", "made"):
        assert ms.load(f"{path}:{name}").positions([1.0])["B"] == pytest.approx(exact, abs=1e-15)
    assert ms.load(f"{path}:drive") == ms.catalog.make("rssr", crank=0.014)


def test_a_path_object_is_a_model():
    path = Path(__file__).parents[2] / "models" / "gallery" / "scotch_yoke.toml"
    assert ms.load(path).mechanism == ms.load(str(path)).mechanism
    with pytest.raises(ms.InputError, match="a model is of type int; give a name or a file"):
        ms.load(7)
