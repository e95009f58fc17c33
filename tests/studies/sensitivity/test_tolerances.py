"""Tolerances from text and tables; worst case, root sum of squares and deviation."""

from functools import cache

import numpy as np
import pytest
from scipy.stats import qmc

import mechsim as ms
from mechsim.io.readers import parametric_model
from mechsim.studies.sensitivity.moved_family import MovedFamily
from mechsim.studies.sensitivity.sensitivity import derivative_table

ANGLES = np.array([0.3, 1.7, 2.9, 4.1])


@cache
def table(model="four_bar", quantities=("C.x", "C.y", "C.z", "rocker")):
    return derivative_table(MovedFamily(parametric_model(model), ANGLES, 1.0), quantities)


def test_worst_case_adds_and_root_sum_of_squares_combines_contributions():
    result = table()
    study = ms.tolerance_study(result, {"crank": 1e-5, "coupler": "±0.02mm"})
    by = result.derivatives("C.x")
    contributions = np.abs(by["crank"]) * 1e-5, np.abs(by["coupler"]) * 2e-5
    assert np.allclose(study.worst("C.x"), contributions[0] + contributions[1], rtol=1e-14)
    assert np.allclose(study.squares("C.x"), np.hypot(*contributions), rtol=1e-14)
    assert study.shares("C.x")["crank"] == pytest.approx(
        (contributions[0] ** 2).sum() / (contributions[0] ** 2 + contributions[1] ** 2).sum()
    )


@pytest.mark.long
def test_the_deviation_is_that_of_solved_mechanisms():
    bounds = {"crank": 1e-4, "coupler": 2e-4}
    study = ms.tolerance_study(table(), bounds)
    nominal = ms.catalog.make("four_bar").dimensions
    paths = [
        ms.catalog.make(
            "four_bar", crank=nominal["crank"][0] + 1e-4 * x, coupler=nominal["coupler"][0] + 2e-4 * y
        ).positions(ANGLES)["C"][:, 0]
        for x, y in qmc.Sobol(2, rng=1).random(256) * 2.0 - 1.0
    ]
    assert np.allclose(np.std(paths, axis=0), study.deviation("C.x"), rtol=0.02)


@pytest.mark.long
def test_a_dimension_and_its_source_cannot_both_vary():
    result = derivative_table(MovedFamily(parametric_model("klann"), ANGLES, 1.0), ["G.x"])
    assert not {"hx", "fy"} & set(result.by)
    with pytest.raises(ms.InputError, match="hx is computed from CF, so that they cannot both vary"):
        ms.tolerance_study(result, {"hx": 1e-5, "CF": 1e-5})


def test_a_radial_clearance_moves_a_point_by_its_radius():
    result = table("slider_crank", quantities=("B.x",))
    study = ms.tolerance_study(result, {"A.clearance": "0.01mm"})
    # the rod transmits the clearance along its line: at most the clearance over the cosine of its angle
    rod_angle = np.arcsin((0.05 * np.sin(ANGLES) - 0.01) / 0.2)
    assert np.allclose(study.worst("B.x"), 1e-5 / np.cos(rod_angle), rtol=1e-9)
    # a pin is uniform in its hole, whose deviation along a line is half of its radius
    assert np.allclose(study.deviation("B.x"), 0.5e-5 / np.cos(rod_angle), rtol=1e-9)
