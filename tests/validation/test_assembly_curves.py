"""The study of assembly curves with a few linkages, and wrong curves that it must reject."""

import assembly_curves as study
import pytest


@pytest.mark.parametrize("close", [False, True], ids=["change point", "near change point"])
def test_only_linkages_with_change_points_have_branch_points(close):
    assert study.check_change_points(3, close, seed=3) == (3, [])


def test_a_curve_of_another_linkage_is_rejected():
    solver = study.catalog.make("four_bar")
    curve = study.trace(solver, starts=0).curves[0]
    assert study.curve_error(solver, curve) <= 1e-14
    longer = solver.with_parameters(coupler=solver.coupler * (1.0 + 1e-7))
    assert study.curve_error(longer, curve) > 1e-8
