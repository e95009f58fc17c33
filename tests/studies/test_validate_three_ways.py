"""Formula, loop equations and MuJoCo are compared alike, so that the faulty one of the three is known."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import mechsim as ms
from mechsim.io.readers import load
from mechsim.kinematics import solvers
from mechsim.mechanism.motion_laws import constant
from mechsim.simulation import simulate
from mechsim.simulation.mjcf import generator
from mechsim.studies.agreement import diagnosis
from mechsim.studies.validate import case_of

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


FLAT = {
    "parallelogram": ("four_bar", {"ground": 0.1, "crank": 0.045, "coupler": 0.1, "rocker": 0.045}),
    "one change point": ("four_bar", {"ground": 0.1, "crank": 0.04, "coupler": 0.12, "rocker": 0.06}),
    "offset slide": ("slider_crank", {"crank": 0.05, "rod": 0.06, "offset": 0.01}),
}


@pytest.mark.long
@pytest.mark.parametrize("which", FLAT)
def test_a_mechanism_with_change_points_passes_validation(which):
    name, lengths = FLAT[which]
    linkage = ms.catalog.make(name, **lengths)
    case = case_of(linkage)
    assert case.verdict.outcome == "passed", case.verdict.reason
    assert np.ptp(case.exact.angle) == pytest.approx(linkage.period)
    # forces do not determine the branch at a change point, so the stepped run swings between two of them
    nearest = np.abs(
        np.exp(1j * case.run.motion.angle[:, None]) - np.exp(1j * np.array(linkage.change_points()))
    )
    assert nearest.min() > 0.04


def test_another_branch_of_a_parallelogram_fails_the_check():
    name, lengths = FLAT["parallelogram"]
    other_branch = ms.catalog.make(name, **lengths, change_point="branch")
    run = simulate(ms.catalog.make(name, **lengths), speed=20.0, method="pose")
    assert ms.crosscheck(run, other_branch).outcome == "changed assembly"


@pytest.mark.slow
def test_the_branch_policy_passes_validation():
    name, lengths = FLAT["one change point"]
    other_branch = ms.catalog.make(name, **lengths, change_point="branch")
    case = case_of(other_branch)
    assert case.verdict.outcome == "passed", case.verdict.reason
    # over the one revolution between two passes of the change point the smooth motion is the same
    run = simulate(other_branch, profile=constant(20.0, 2.0), method="pose")
    assert ms.crosscheck(run, ms.catalog.make(name, **lengths)).outcome == "changed assembly"


FIVE_BAR = load("five_bar")


@pytest.mark.long
def test_each_driver_has_its_own_check_by_both_methods():
    case = case_of(FIVE_BAR)
    assert case.passed, case.verdict.reason
    reported = {check.title for check in case.verdict.checks if "drive" in check.title}
    assert reported == {f"{route}: drive: {name}" for route in ("pose", "step") for name in ("left", "right")}
