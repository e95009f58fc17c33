"""Sparse square systems are solved in the order that makes them banded, as numpy solves the dense ones."""

from dataclasses import replace

import numpy as np
import pytest

from mechsim.numerics.arrays import EPS
from mechsim.numerics.banded import (
    BandedSystems,
    SparseMatrices,
    band,
    entries_of,
    least_norm_systems,
)
from mechsim.numerics.damped_band import DampedBand, normal_band
from mechsim.numerics.rank import least_norm, null_space, pivot_columns

COUNT = 150


def shuffled(links: list[tuple[int, int]]) -> tuple[SparseMatrices, np.ndarray]:
    """Return sparse matrices of three instants in a random order, and the dense ones.

    Their entries are at the links and on a diagonal, which is dominant.
    """
    random = np.random.default_rng(1)
    entries = np.array([*((i, i) for i in range(COUNT)), *links])
    rows, columns = (random.permutation(COUNT)[entries[:, k]] for k in (0, 1))
    values = random.uniform(0.1, 0.9, (len(entries), 3)) * random.choice([-1.0, 1.0], (len(entries), 1))
    values[:COUNT] *= 5.0
    dense = np.zeros((3, COUNT, COUNT))
    dense[:, rows, columns] = values.T
    return SparseMatrices(rows, columns, values, (COUNT, COUNT)), dense


def chain(width: int) -> list[tuple[int, int]]:
    return [(i, i - k) for k in range(1, width + 1) for i in range(k, COUNT)]


def systems(matrices: SparseMatrices, border: int = 0) -> tuple[BandedSystems, np.ndarray]:
    """Return systems of these matrices, the last of whose equations are dense, and the dense matrices."""
    dense, rows = matrices.dense.transpose(2, 0, 1), np.arange(COUNT - border)
    stated = (pivot_columns(null_space(dense[0, rows]))[0][:border],) if border else ()
    order = band(matrices, rows, np.arange(COUNT), *stated)
    # a chain of equations, each with the unknown before it, is within a diagonal or two of the main one
    assert border or sum(order.widths) <= 4
    dense[:, COUNT - border :] = np.random.default_rng(3).standard_normal((3, border, COUNT))
    values = matrices.values[order.entries]
    return BandedSystems(order, values, *((dense[:, COUNT - border :],) if border else ())), dense


@pytest.mark.parametrize(("width", "border"), [(1, 0), (2, 0), (2, 1), (2, 2)])
def test_a_shuffled_chain_with_a_border_is_solved_as_dense_matrices_are(width, border):
    matrices, _ = shuffled(chain(width))
    if border:
        matrices = replace(matrices, values=matrices.values[:, :1] * np.array([1.0, 0.99, 1.01]))
    own, dense = systems(matrices, border)
    close = {"rtol": 1e-8, "atol": 1e-10} if border else {"rtol": 1e-9, "atol": 1e-11}
    np.testing.assert_array_equal(own.dense, dense)
    right = np.random.default_rng(2).standard_normal((6, COUNT))
    expected = np.linalg.solve(np.tile(dense, (2, 1, 1)), right[..., None])[..., 0]
    np.testing.assert_allclose(own.solution(right), expected, **close)
    expected = np.linalg.solve(dense.transpose(0, 2, 1), right[:3, :, None])[..., 0]
    np.testing.assert_allclose(own.solution(right[:3], transposed=True), expected, **close)
    sign, logarithm = np.linalg.slogdet(dense)
    np.testing.assert_array_equal(own.determinant[0], sign)
    np.testing.assert_allclose(own.determinant[1], logarithm, rtol=1e-12)
    values = np.linalg.svd(dense, compute_uv=False)
    np.testing.assert_allclose(own.smallest_singular_values(), values[:, -1], rtol=1e-9)
    # after three steps, from above
    estimate = own.smallest_singular_values(1.0)
    assert (values[:, -1] * (1.0 + 1e-12) < estimate).all()
    assert (estimate < 3.0 * values[:, -1]).all()


def test_the_smallest_singular_value_of_separate_blocks_is_that_of_the_dense_matrix():
    matrices, _ = shuffled([(i, i - 1) for i in range(COUNT) if i % 5 and (i % 3 or i > 90)])
    own, dense = systems(matrices)
    assert {*own.band.blocks[1].tolist()} == {1, 2, 3, 5}
    values = np.linalg.svd(dense, compute_uv=False)[:, -1]
    np.testing.assert_allclose(own.smallest_singular_values(), values, rtol=1e-12)
    least = int(np.linalg.slogdet(dense)[1].argmin())
    assert own.least_singular_value(0.2) == pytest.approx(values[least], rel=1e-12)


def test_products_of_sparse_matrices_are_those_of_dense_ones():
    matrices, dense = shuffled(chain(2))
    right = np.random.default_rng(2).standard_normal((3, COUNT))
    np.testing.assert_allclose(matrices.times(right.T), np.einsum("nij,nj->in", dense, right), atol=1e-13)


def test_damped_steps_of_sparse_equations_are_those_of_dense_matrices():
    matrices, dense = shuffled(chain(2))
    unknown = np.delete(np.arange(COUNT), [3, 60])
    order = normal_band(matrices, unknown)
    right, damping = np.random.default_rng(2).standard_normal((3, COUNT)), np.array([0.1, 0.2, 0.3])
    steps = DampedBand(right, matrices, order, lambda _, trace: damping * trace)
    selected = dense[:, :, unknown]
    square = selected.transpose(0, 2, 1) @ selected
    added = damping * np.trace(square, axis1=1, axis2=2)
    square += added[:, None, None] * np.eye(len(unknown))
    expected = np.linalg.solve(square, selected.transpose(0, 2, 1) @ right[..., None])[..., 0]
    np.testing.assert_allclose(steps.solution(right), expected, rtol=1e-11)


def test_a_singular_system_is_reported_and_has_the_singular_value_zero():
    matrices, _ = shuffled(chain(1))
    values = matrices.values.copy()
    values[(matrices.rows == 5), 1] = 0.0
    own, _ = systems(replace(matrices, values=values))
    with pytest.raises(np.linalg.LinAlgError):
        own.solution(np.ones((3, COUNT)))
    assert own.determinant[0].tolist()[1] == 0.0
    assert own.smallest_singular_values()[1] <= 1e-12 < own.smallest_singular_values()[0]


def test_unknowns_that_all_share_one_stay_dense():
    everything_on_one = [(i, 0) for i in range(1, COUNT)] + [(0, i) for i in range(1, COUNT)]
    matrices, _ = shuffled(everything_on_one)
    assert band(matrices, np.arange(COUNT), np.arange(COUNT)) is None


def test_equations_that_determine_no_unknown_have_no_order():
    matrices, _ = shuffled(chain(1))
    kept = matrices.columns != 7
    others = replace(
        matrices, rows=matrices.rows[kept], columns=matrices.columns[kept], values=matrices.values[kept]
    )
    assert band(others, np.arange(COUNT), np.arange(COUNT)) is None


def test_solutions_of_least_norm_are_those_of_the_pseudo_inverse_also_where_rows_are_dependent():
    """A chain without its last equation has one null vector; the last instant has nearly equal equations."""
    _, dense = shuffled(chain(1))
    jacobian, right = dense[:, :-1], np.random.default_rng(2).standard_normal((3, COUNT - 1))
    # an equation that is zero, as out of a plane
    jacobian[:, 7], right[:, 7] = 0.0, 0.0
    jacobian[2, 8], right[2, 8] = jacobian[2, 9] + 1e-7 * jacobian[2, 8], right[2, 9]
    expected = least_norm(jacobian, right)
    sparse, dense = entries_of(jacobian), lambda which: least_norm(jacobian[which], right[which])
    error = np.linalg.norm(sparse.least_norm(right, {}, dense, regular=True) - expected, axis=1)
    # both are exact to rounding times the condition, 11, 15 and 2e7; measured 1.6 times that at most
    conditions = np.linalg.cond(np.delete(jacobian, 7, 1))
    assert (error <= 4.0 * EPS * conditions * np.linalg.norm(expected, axis=1)).all()
    systems = least_norm_systems(sparse, {})
    bases, independent = systems.null_bases
    assert independent.tolist() == [True, True, False]
    assert bases.shape == (3, COUNT, 2)
    assert np.abs(jacobian[:2] @ bases[:2]).max() < 1e-14
    products = np.swapaxes(bases, 1, 2)[:2] @ bases[:2]
    np.testing.assert_allclose(products, np.tile(np.eye(2), (2, 1, 1)), atol=1e-14)
    _, multipliers = systems.solved((right[:, None] @ jacobian)[None, :, 0])
    np.testing.assert_allclose(multipliers[0, :2], np.delete(right, 7, 1)[:2], rtol=1e-9, atol=1e-11)
    # the transposed equations are overdetermined
    columns, right = sparse.transposed, np.random.default_rng(3).standard_normal((3, COUNT))
    exact = [np.linalg.lstsq(matrix.T, side)[0] for matrix, side in zip(jacobian, right, strict=True)]
    np.testing.assert_allclose(columns.least_squares(right, {})[:2], exact[:2], atol=1e-12)
    rows = columns.restricted(np.delete(np.arange(COUNT - 1), 7))
    others, whole = replace(rows, values=rows.values[:, [1, 0, 0]]), rows.whole()
    signs = np.linalg.slogdet(np.swapaxes(whole, 1, 2) @ others.whole())[0]
    assert np.array_equal(rows.product_signs(others, {}), signs)
