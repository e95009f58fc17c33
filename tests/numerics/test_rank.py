"""Numerical rank, null spaces and least-norm solutions of matrices whose singular values are known."""

import numpy as np
import pytest
import scipy.linalg

from mechsim.numerics.rank import (
    least_norm,
    null_space,
    pivot_columns,
    pseudo_inverse,
    rank,
    significant,
    singular_values,
)

# rotations, so that the singular values are those of the diagonal matrix; neither is symmetric
LEFT = np.array([[2.0, -1.0, 2.0], [2.0, 2.0, -1.0], [-1.0, 2.0, 2.0]]) / 3.0
RIGHT = np.array([[-6.0, 2.0, 3.0], [3.0, 6.0, 2.0], [2.0, -3.0, 6.0]]) / 7.0


def with_values(*values):
    return LEFT @ np.diag(values) @ RIGHT


def test_a_singular_value_is_nonzero_above_1e_9_of_the_largest_and_above_1e_13():
    values = np.array([[2.0, 2.1e-9, 1.9e-9], [1e-6, 1.1e-13, 0.9e-13], [0.9e-13, 5e-14, 0.0]])
    assert significant(values).tolist() == [[True, True, False], [True, True, False], [False] * 3]
    assert significant(np.zeros((2, 0))).shape == (2, 0)


def test_tolerance_and_floor_determine_significant_values():
    values = np.array([2.0, 3e-5, 1e-5, 1e-7])
    assert significant(values, 1e-5).tolist() == [True, True, False, False]
    assert significant(0.01 * values, 1e-5, 1e-5).tolist() == [True, False, False, False]


def test_rank_counts_the_nonzero_singular_values():
    assert [rank(with_values(1.0, 1e-3, least)) for least in (1e-8, 1e-10, 0.0)] == [3, 2, 2]
    assert rank(with_values(1.0, 1e-3, 1e-8), 1e-5) == 2
    assert rank(1e-14 * LEFT) == 0
    assert rank(with_values(1e-3, 1e-4, 1e-6), 1e-9, 1e-5) == 2


def test_pivots_agree_with_lapack():
    rng = np.random.default_rng(3)
    for rows, columns, independent in ((6, 4, 4), (5, 9, 3), (12, 12, 12)):
        matrix = rng.normal(size=(rows, independent)) @ rng.normal(size=(independent, columns))
        order, sizes = pivot_columns(matrix)
        r, expected = scipy.linalg.qr(matrix, mode="r", pivoting=True)
        assert order[:independent].tolist() == expected[:independent].tolist()
        assert np.allclose(sizes, np.abs(np.diag(r)), rtol=1e-12, atol=1e-13)


def test_a_null_space_belongs_to_zero_singular_values():
    matrix = with_values(1.0, 0.5, 1e-12)
    left, right = null_space(matrix.T), null_space(matrix)
    np.testing.assert_allclose(left.T @ left, np.outer(LEFT[:, 2], LEFT[:, 2]), atol=1e-11)
    np.testing.assert_allclose(right.T @ right, np.outer(RIGHT[2], RIGHT[2]), atol=1e-11)
    assert null_space(np.zeros((2, 0))).shape == (0, 0)
    np.testing.assert_array_equal(null_space(np.zeros((0, 2))), np.eye(2))


@pytest.mark.parametrize("values", [(1.0, 0.5, 1e-6), (1.0, 1e-3, 1e-10), (1e-14, 1e-14, 1e-14)])
def test_solutions_ignore_zero_singular_values(values):
    kept = np.array([value if value > 1e-9 * values[0] and value > 1e-13 else np.inf for value in values])
    exact = RIGHT.T @ np.diag(1.0 / kept) @ LEFT.T
    matrix, right = with_values(*values), np.array([1.0, -2.0, 3.0])
    close = {"rtol": 1e-8, "atol": 1e-8 / kept[0]}
    stacked = np.stack([matrix, np.diag([3.0, 2.0, 1.0])])
    np.testing.assert_allclose(pseudo_inverse(stacked)[0], exact, **close)
    np.testing.assert_allclose(pseudo_inverse(stacked)[1], np.diag([1 / 3, 0.5, 1.0]), rtol=1e-14)
    np.testing.assert_allclose(least_norm(matrix, right), exact @ right, **close)
    np.testing.assert_allclose(least_norm(stacked, np.stack([right, right]))[1], [1 / 3, -1.0, 3.0])


def test_a_tall_matrix_has_a_wide_pseudo_inverse():
    tall = np.array([[3.0, 0.0], [4.0, 0.0], [0.0, 2.0]])
    np.testing.assert_allclose(
        pseudo_inverse(tall), [[0.12, 0.16, 0.0], [0.0, 0.0, 0.5]], rtol=1e-14, atol=1e-16
    )


def test_a_solution_ignores_singular_values_below_the_floor():
    right = np.ones(3)
    assert least_norm(1e-6 * np.eye(3), right) == pytest.approx(1e6 * right)
    assert least_norm(1e-14 * np.eye(3), right).tolist() == [0.0, 0.0, 0.0]
    assert least_norm(1e-6 * np.eye(3), right, 1e-5, 1e-5).tolist() == [0.0, 0.0, 0.0]


def test_rows_of_zeros_do_not_count_in_large_matrices():
    # 250 rows, of which three are independent
    matrix = np.zeros((250, 5))
    matrix[[3, 100, 249], [0, 2, 4]] = 1.0
    matrix[7] = matrix[3] + matrix[100]
    assert rank(matrix) == 3
    assert null_space(matrix).shape == (2, 5)
    # as many singular values as of the whole matrix, also where fewer rows are not zero
    values = np.sqrt([3.0, 1.0, 1.0, 0.0, 0.0])
    assert singular_values(matrix) == pytest.approx(values, abs=1e-15)
    matrix[7] = 0.0
    assert singular_values(matrix[None])[0].tolist() == [1.0, 1.0, 1.0, 0.0, 0.0]
