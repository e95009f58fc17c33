"""The study of change points with a few linkages."""

import change_points as study
import closed_form_at_dead_centres as case
import numpy as np
import pytest


@pytest.mark.parametrize("close", [False, True], ids=["change point", "near change point"])
@pytest.mark.parametrize("method", ["closed form", "loop equations", "MuJoCo, poses"])
def test_no_linkage_is_silently_wrong(method, close):
    result = study.tally(method, study.random_linkages(6, close, seed=3))
    assert (result.correct, result.rejected, result.wrong) == (6, 0, 0)


def test_the_assembly_is_the_same_at_high_curvature():
    # closer to a change point the rounding of the lengths decides
    sharpest = [
        (0.038107835611592526, 0.0851754843762121, 0.14693424644299166, 0.19400189520751593),
        (0.037658439604518194, 0.06527316173992515, 0.07922779501300287, 0.10684251714834374),
    ]
    alike = [(0.06679722798869933, 0.07148163874581459, 0.11481950387243817, 0.11950391462955343)]
    for arguments, count in ((("loop equations", sharpest), 2), (("MuJoCo, poses", alike, "branch"), 1)):
        result = study.tally(*arguments)
        assert (result.correct, result.rejected, result.wrong) == (count, 0, 0)


def test_a_method_with_the_wrong_policy_is_rejected(monkeypatch):
    monkeypatch.setitem(
        study.METHODS,
        "branch policy",
        lambda linkage: linkage.positions(study.ANGLES, change_point="branch")["B"],
    )
    assert study.tally("branch policy", study.random_linkages(3, False)).wrong == 3


DISTANCES = np.array([1e-12, 1e-7, 1e-2])


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "rssr", "rrsrr"])
def test_errors_are_at_most_those_of_rounded_inputs(name):
    linkage, point = case.LINKAGES[name]
    error, condition = case.errors(linkage, point, case.angles_near(linkage, DISTANCES))
    assert (error <= case.MAX_UNITS * case.EPS * condition).all()
    # the condition grows as the inverse square root of the distance
    assert condition[0] / condition[2] == pytest.approx(1e5, rel=0.5)


def test_a_dead_centre_at_a_zero_of_the_published_divisor_costs_no_digit():
    linkage = case.dead_centre_at_zero_v3x()
    angles = case.angles_near(linkage, case.DISTANCES)
    error, condition = case.errors(linkage, "P3", angles)
    assert (error <= case.MAX_UNITS * case.EPS * condition).all()
