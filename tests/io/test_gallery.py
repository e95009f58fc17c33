"""Gallery mechanisms satisfy their laws by the loop equations and by MuJoCo."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from mechsim.compare.quantities import reach_of
from mechsim.io import catalog, gallery
from mechsim.io.python_object import run_object
from mechsim.io.readers import load
from mechsim.numerics.arrays import EPS
from mechsim.studies.agreement.agreement import agreement
from mechsim.studies.agreement.candidate import values_of_function
from mechsim.studies.agreement.comparison import candidate_check, formula_tolerance, scales_of
from mechsim.studies.agreement.evaluation_points import evaluation_points
from mechsim.studies.validate import case_of

FILES = gallery.files()


@pytest.fixture(params=FILES, scope="module")
def gallery_solver(request):
    return load(request.param)


@pytest.mark.long
def test_gallery_mechanisms_pass_validation_and_satisfy_their_law(gallery_solver):
    case = case_of(gallery_solver, quick=True)
    assert case.passed, case.verdict.reason
    reported = [check for check in case.verdict.checks if check.method == "formula"]
    assert reported
    # far below the tolerance of other formulas: two methods differ by rounding, measured 8 eps
    assert all(check.worst <= 512 * EPS * reach_of(case.exact) for check in reported)


@pytest.mark.slow
def test_stepped_gallery_mechanisms_pass_validation(gallery_solver):
    case = case_of(gallery_solver)
    assert case.passed, case.verdict.reason


@pytest.mark.long
def test_the_law_rejects_a_dimension_off_by_a_thousandth(gallery_solver):
    name = next(iter(gallery_solver.parameters))
    wrong = load(gallery_solver.name, {name: f"1.001*{gallery_solver.parameters[name]!r}"})
    evaluation = evaluation_points(wrong, speed=1.0)
    law = values_of_function(run_object(gallery_solver.formula), evaluation, "law", gallery_solver.parameters)
    scales = scales_of(evaluation, law)
    assert not all(
        candidate_check(
            item, evaluation.exact(item.quantity), evaluation, formula_tolerance(item, scales, None)
        ).passed
        for item in law
    )


@pytest.mark.long
def test_a_formula_of_a_file_is_accepted_only_to_rounding(gallery_solver):
    evaluation = evaluation_points(gallery_solver, speed=1.0)
    formula = run_object(gallery_solver.formula)
    law = values_of_function(formula, evaluation, "law", gallery_solver.parameters)
    error = 1e-11 * evaluation.solver.mechanism.characteristic_length
    wrong = [replace(item, values=item.values + error) for item in law]
    for values, accepted in ((law, True), (wrong, False)):
        checks = agreement(evaluation, values, "law", diagnose=False, exact_formula=True).checks
        assert [check.passed for check in checks] == [accepted] * len(checks)


def test_a_law_uses_changed_parameters():
    wide = load("scotch_yoke", {"crank": "4 cm"})
    assert case_of(wide, quick=True).passed


def test_the_lambda_linkage_is_nearly_straight_over_half_a_turn():
    position = load("chebyshev_lambda").positions(np.linspace(np.pi / 2, 3 * np.pi / 2, 91))["P"]
    assert np.ptp(position[:, 1]) < 0.01 * np.ptp(position[:, 0])
    assert not np.ptp(position[:, 1]) < 1e-3 * np.ptp(position[:, 0])


@pytest.mark.parametrize(("name", "foot"), [("jansen", "foot"), ("klann", "G")])
def test_the_foot_of_a_leg_mechanism_stays_near_the_ground(name, foot):
    height = load(name).positions(np.linspace(0.0, 2.0 * np.pi, 181))[foot][:, 1]
    close = height < height.min() + 0.1 * np.ptp(height)
    assert close.mean() > 0.4
    assert np.ptp(height) > 0.02


def test_the_gallery_is_read_from_package_or_source_tree(monkeypatch, tmp_path):
    package = tmp_path / "mechsim"
    (package / "models" / "gallery").mkdir(parents=True)
    (tmp_path / "models" / "gallery").mkdir(parents=True)
    (package / "models" / "gallery" / "inside.toml").touch()
    (tmp_path / "models" / "gallery" / "source.toml").touch()
    monkeypatch.setattr(catalog, "PACKAGE", package)
    assert list(gallery.files()) == ["inside"]
    shutil.rmtree(package / "models")
    assert list(gallery.files()) == ["source"]
