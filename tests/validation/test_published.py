"""Published problems, written with the public face only: short versions of validation/published/."""

import importlib.util
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "validation" / "published"


def case(name: str):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(FOLDER))
    try:
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(str(FOLDER))
    return module


def assert_all_met(rows) -> None:
    rows = [row for row in rows if row.unit != "s" or row.bound < 1e-3]  # times depend on the machine
    assert rows
    assert not [row for row in rows if not row.passed]


def test_the_pendulum_swings_as_elliptic_functions_say() -> None:
    assert_all_met(case("a01_pendulum").rows())


def test_two_four_bars_pass_the_singular_pose_on_the_right_branch() -> None:
    problem = case("a02_four_bars")
    assert_all_met(problem.reference_rows() + problem.rows(2, 10.0, 1e-3, 1e-4, 1e-4))


@pytest.mark.slow
def test_forty_four_bars_pass_the_singular_pose_on_the_right_branch() -> None:
    assert_all_met(case("a02_four_bars").rows(40, 5.0, 1e-3, 5e-4, 5e-4))


def test_the_squeezer_has_eight_digits_in_mujoco() -> None:
    assert_all_met(case("a03_squeezer").stepped_rows())


def test_the_squeezer_has_nine_digits_by_the_reduced_equation() -> None:
    assert_all_met(case("a03_squeezer").reduced_rows())


def test_bricards_linkage_moves_with_one_redundant_constraint_and_keeps_its_energy() -> None:
    assert_all_met(case("a04_bricard").rows(2.0, 5e-4, 1e-5))


def test_the_spatial_slider_crank_starts_with_its_exact_values_and_keeps_its_energy() -> None:
    assert_all_met(case("rsup").rows(1.0, 1e-3, 0.1))


def test_a_squeezer_with_one_mass_a_thousandth_off_is_seen() -> None:
    problem = case("a03_squeezer")
    problem.MASSES = (*problem.MASSES[:6], problem.MASSES[6] * 1.001)
    assert any(not row.passed for row in problem.stepped_rows() if row.unit == "scd")
