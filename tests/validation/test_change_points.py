"""The study of change points with a few linkages."""

import change_points as study
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
