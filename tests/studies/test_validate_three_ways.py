"""Formula, loop equations and MuJoCo are compared alike, so that the faulty one of the three is known."""

import shutil
from pathlib import Path

import pytest

import mechsim as ms
from mechsim.kinematics import solvers
from mechsim.simulation.mjcf import generator
from mechsim.studies.agreement import diagnosis

MODELS = Path(ms.catalog.models())
# mechanism: file of its formula, a line of it and a wrong one, and a wrong dimension. That of the first
# gives link frames, those of the others points
MECHANISMS = {
    "four_bar": (
        "four_bar.py",
        ("pivot + self.rocker *", "pivot + 1.001 * self.rocker *"),
        {"coupler": "91.1 mm"},
    ),
    "hoeken": ("gallery/dyads.py", ("B=(a + tracer) / 2.0", "B=(a + tracer) / 1.999"), {"arm": "175.2mm"}),
    "cardan_joint": (
        "gallery/shafts.py",
        ("np.cos(shaft_angle), np.cos(angle)", "0.999, np.cos(angle)"),
        {"bend": "30.1deg"},
    ),
}


@pytest.fixture(autouse=True)
def _no_search_for_a_cause(monkeypatch):
    monkeypatch.setattr(diagnosis, "diagnosis", lambda misfit: ())


def failures(model):
    """Return the methods of which a check fails."""
    return {check.method for check in ms.validate(model, stepped=False).checks if not check.passed}


@pytest.fixture(params=MECHANISMS)
def name(request):
    return request.param


def wrong_mechanism(name):
    return ms.load(name, MECHANISMS[name][2]).mechanism


@pytest.mark.long
def test_a_wrong_formula_is_rejected(name, tmp_path):
    file, (right, wrong), _ = MECHANISMS[name]
    path = shutil.copy((MODELS / file).with_name(f"{name}.toml"), tmp_path)
    code = (MODELS / file).read_text()
    (tmp_path / Path(file).name).write_text(code)
    assert failures(path) == set()
    assert right in code
    (tmp_path / Path(file).name).write_text(code.replace(right, wrong))
    assert failures(path) == {"formula"}


@pytest.mark.long
def test_a_wrong_model_in_mujoco_is_rejected(name, monkeypatch):
    wrong, cut = wrong_mechanism(name), generator.cut_loops
    monkeypatch.setattr(generator, "cut_loops", lambda _, *a, **options: cut(wrong, *a, **options))
    assert failures(name) == {"pose"}


@pytest.mark.long
def test_wrong_loop_equations_are_rejected(name, monkeypatch):
    wrong, path = wrong_mechanism(name), solvers.driven_path
    monkeypatch.setattr(solvers, "driven_path", lambda _, *a: path(wrong, *a))
    assert failures(name) == {"formula", "pose"}
