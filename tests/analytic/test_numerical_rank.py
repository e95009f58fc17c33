"""Which singular values tell something: the same rule on both roads, each in its own code."""

import numpy as np
import pytest

from mechsim.analytic.loops import numerical_rank as by_formulas
from mechsim.simulation import numerical_rank as by_mujoco

# turns, so that singular values are what they are said to be; neither is symmetric whatever its signs
TURN = np.array([[2.0, -1.0, 2.0], [2.0, 2.0, -1.0], [-1.0, 2.0, 2.0]]) / 3.0
OTHER = np.array([[-6.0, 2.0, 3.0], [3.0, 6.0, 2.0], [2.0, -3.0, 6.0]]) / 7.0


def with_values(*values):
    return TURN @ np.diag(values) @ OTHER


@pytest.mark.parametrize("telling", [by_formulas.significant, by_mujoco.significant])
def test_a_value_tells_if_it_is_more_than_a_part_of_1e_9_of_the_largest_and_more_than_1e_13_at_all(telling):
    values = np.array([[2.0, 2.1e-9, 1.9e-9], [1e-6, 1.1e-13, 0.9e-13], [0.9e-13, 5e-14, 0.0]])
    assert telling(values).tolist() == [[True, True, False], [True, True, False], [False] * 3]
    assert telling(np.zeros((2, 0))).shape == (2, 0)


def test_another_part_and_another_floor_may_be_asked_of_the_formulas():
    values = np.array([2.0, 3e-5, 1e-5, 1e-7])
    assert by_formulas.significant(values, 1e-5).tolist() == [True, True, False, False]
    assert by_formulas.significant(0.01 * values, 1e-5, 1e-5).tolist() == [True, False, False, False]


def test_ranks_count_what_tells():
    assert [by_formulas.rank(with_values(1.0, 1e-3, part)) for part in (1e-8, 1e-10, 0.0)] == [3, 2, 2]
    assert by_formulas.rank(with_values(1.0, 1e-3, 1e-8), 1e-5) == 2
    assert by_formulas.rank(1e-14 * TURN) == 0


@pytest.mark.parametrize("values", [(1.0, 0.5, 1e-6), (1.0, 1e-3, 1e-10), (1e-14, 1e-14, 1e-14)])
def test_solutions_leave_out_what_does_not_tell(values):
    told = np.array([value if value > 1e-9 * values[0] and value > 1e-13 else np.inf for value in values])
    exact = OTHER.T @ np.diag(1.0 / told) @ TURN.T
    matrix = with_values(*values)
    close = {"rtol": 1e-8, "atol": 1e-8 / told[0]}
    several = np.stack([matrix, np.diag([3.0, 2.0, 1.0])])
    np.testing.assert_allclose(by_mujoco.pseudo_inverse(several)[0], exact, **close)
    np.testing.assert_allclose(by_mujoco.pseudo_inverse(several)[1], np.diag([1 / 3, 0.5, 1.0]), rtol=1e-14)
    np.testing.assert_allclose(
        np.linalg.pinv(matrix, rcond=by_formulas.relative_cutoff(matrix)), exact, **close
    )


def test_a_tall_matrix_has_a_wide_pseudo_inverse():
    tall = np.array([[3.0, 0.0], [4.0, 0.0], [0.0, 2.0]])
    np.testing.assert_allclose(
        by_mujoco.pseudo_inverse(tall), [[0.12, 0.16, 0.0], [0.0, 0.0, 0.5]], rtol=1e-14, atol=1e-16
    )


def test_a_part_that_is_left_out_of_solutions_is_never_less_than_the_floor_over_the_largest():
    matrices = np.stack([np.eye(3), 1e-6 * np.eye(3), 1e-14 * np.eye(3)])
    assert by_formulas.relative_cutoff(matrices) == pytest.approx([1e-9, 1e-7, 1.0])
    assert by_formulas.relative_cutoff(matrices, 1e-5) == pytest.approx([1e-5, 1e-5, 1.0])
    assert by_formulas.relative_cutoff(matrices, 1e-5, 1e-5) == pytest.approx([1e-5, 1.0, 1.0])
