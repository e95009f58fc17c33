"""Tolerances from text and tables; worst case, root sum of squares and Monte Carlo compared."""

from functools import cache

import numpy as np
import pytest

from mechsim.errors import InputError
from mechsim.studies.sensitivity import monte_carlo
from mechsim.studies.sensitivity.moved_family import MovedFamily
from mechsim.studies.sensitivity.sensitivity import derivative_table
from mechsim.studies.sensitivity.tolerance_analysis import tolerance_study
from mechsim.studies.sensitivity.tolerances import parsed_tolerances
from mechsim.subjects.readers import parametric_model

ANGLES = np.array([0.3, 1.7, 2.9, 4.1])


@cache
def table(model="four_bar", quantities=("C.x", "C.y", "C.z", "rocker")):
    return derivative_table(MovedFamily(parametric_model(model), ANGLES, 1.0), quantities)


def test_worst_case_adds_and_root_sum_of_squares_combines_contributions():
    result = table()
    study = tolerance_study(result, {"crank": 1e-5, "coupler": "±0.02mm"}, samples=0)
    by = result.derivatives("C.x")
    contributions = np.abs(by["crank"]) * 1e-5, np.abs(by["coupler"]) * 2e-5
    assert np.allclose(study.worst("C.x"), contributions[0] + contributions[1], rtol=1e-14)
    assert np.allclose(study.squares("C.x"), np.hypot(*contributions), rtol=1e-14)
    assert study.shares("C.x")["crank"] == pytest.approx(
        (contributions[0] ** 2).sum() / (contributions[0] ** 2 + contributions[1] ** 2).sum()
    )
    assert study.sampled is None


def test_monte_carlo_errors_stay_below_the_worst_case():
    result = table(quantities=("rocker",))
    study = tolerance_study(result, {"crank": 1e-6, "coupler": 2e-6}, samples=20_000)
    worst = study.worst("rocker.q")
    assert (study.random("rocker.q")["most"] <= worst).all()
    assert (study.random("rocker.q")["most"] >= 0.9 * worst).all()


@pytest.mark.long
@pytest.mark.parametrize("distribution", ["uniform", pytest.param("normal", marks=pytest.mark.slow)])
def test_monte_carlo_of_small_tolerances_has_the_linear_deviation(distribution):
    result = table("hoeken", quantities=("rocker",))
    limits = {"crank": 1e-6, "arm": 2e-6, "A.clearance": 1e-6}
    requested = parsed_tolerances(
        limits, result.moved.designs.dimensions, result.moved.solver.mechanism, distribution
    )
    study = tolerance_study(result, requested, samples=40_000)
    random = study.random("rocker.q")
    assert study.sampled.sampling.order == 1
    assert np.abs(random["std"] / study.deviation("rocker.q") - 1.0).max() <= 0.02
    assert study.sampled.sampling.expansion_error > 0.0


@pytest.mark.long
def test_samples_are_solved_if_the_expansion_is_inaccurate(monkeypatch):
    monkeypatch.setattr(monte_carlo, "MAX_SOLVED", 20)
    monkeypatch.setattr(monte_carlo, "MAX_VERIFIED", 8)
    result = derivative_table(MovedFamily(parametric_model("hoeken"), np.array([1.0]), 1.0), ["rocker"])
    study = tolerance_study(result, {"crank": 0.06, "ground": 0.06, "arm": 0.06}, samples=100)
    assert (study.sampled.sampling.order, study.sampled.samples) == (0, 20)


@pytest.mark.long
def test_a_dimension_and_its_source_cannot_both_vary():
    result = derivative_table(MovedFamily(parametric_model("klann"), ANGLES, 1.0), ["G.x"])
    assert not {"hx", "fy"} & set(result.by)
    with pytest.raises(InputError, match="hx is computed from CF, so that they cannot both vary"):
        tolerance_study(result, {"hx": 1e-5, "CF": 1e-5})


def test_a_radial_clearance_moves_a_point_by_its_radius():
    result = table("slider_crank", quantities=("B.x",))
    study = tolerance_study(result, {"A.clearance": "0.01mm"}, samples=30_000)
    # the rod transmits the clearance along its line: at most the clearance over the cosine of its angle
    rod_angle = np.arcsin((0.05 * np.sin(ANGLES) - 0.01) / 0.2)
    assert np.allclose(study.worst("B.x"), 1e-5 / np.cos(rod_angle), rtol=1e-9)
    assert np.abs(study.random("B.x")["std"] / (0.5e-5 / np.cos(rod_angle)) - 1.0).max() <= 0.02


def test_tolerances_without_an_assembly_are_rejected():
    with pytest.raises(InputError, match="none of 60 random mechanisms within the tolerances"):
        tolerance_study(table(), {"crank": 1000.0}, samples=60)


def test_a_slide_has_no_radial_clearance():
    result = table("slider_crank", quantities=("B.x",))
    with pytest.raises(InputError, match="radial clearances exist for revolute or spherical joints only"):
        tolerance_study(result, {"slide.clearance": 1e-5}, samples=0)
