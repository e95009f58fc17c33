"""Published problems with public names only: short versions of validation/published/."""

import sys
from importlib import import_module as case
from pathlib import Path

import pytest

# scripts of this folder import each other
sys.path.insert(0, str(Path(__file__).parents[2] / "validation" / "published"))


def assert_all_passed(rows) -> None:
    rows = [row for row in rows if row.unit != "s" or row.tolerance < 1e-3]  # times depend on the machine
    assert rows
    assert not [row for row in rows if not row.passed]


def test_the_pendulum_agrees_with_elliptic_functions() -> None:
    assert_all_passed(case("a01_pendulum").rows())


def test_two_four_bars_pass_the_singular_pose_on_the_correct_branch() -> None:
    problem = case("a02_four_bars")
    assert_all_passed(problem.reference_rows() + problem.rows(2, 10.0, 1e-3, 1e-4, 1e-4))


@pytest.mark.slow
def test_forty_four_bars_pass_the_singular_pose_on_the_correct_branch() -> None:
    assert_all_passed(case("a02_four_bars").rows(40, 5.0, 1e-3, 5e-4, 5e-4))


def test_the_squeezer_has_eight_digits_in_mujoco() -> None:
    assert_all_passed(case("a03_squeezer").stepped_rows())


def test_the_squeezer_has_nine_digits_by_the_reduced_equation() -> None:
    assert_all_passed(case("a03_squeezer").reduced_rows())


def test_bricards_linkage_conserves_energy_with_a_redundant_constraint() -> None:
    assert_all_passed(case("a04_bricard").rows(2.0, 4e-4, 1e-5))


def test_the_spatial_slider_crank_conserves_energy_from_exact_values() -> None:
    assert_all_passed(case("rsup").rows(1.0, 1e-3, 0.1))


def test_a_squeezer_with_a_mass_error_of_a_thousandth_fails(monkeypatch) -> None:
    problem = case("a03_squeezer")
    monkeypatch.setattr(problem, "MASSES", (*problem.MASSES[:6], problem.MASSES[6] * 1.001))
    assert any(not row.passed for row in problem.stepped_rows() if row.unit == "scd")


def test_the_stiff_governor_satisfies_lagranges_equation() -> None:
    governor = case("a05_governor")
    result = governor.compare(0.02, samples=8)
    # ten times the tolerance of a step, 3e-13: a short run takes explicit steps, whose error is not only
    # rounding; measured 6e-17 rad, 5e-14 rad and 2e-13 m
    assert result.shaft < 1e-14
    assert result.arm < 3e-12
    assert result.slider < 3e-12
    # a reference whose slider starts 1 um lower is detected
    assert governor.compare(0.02, samples=8, height=governor.HEIGHT - 1e-6).slider > 1e-8
