"""Linear complementarity problems against their three conditions."""

from itertools import product

import numpy as np
import pytest

from mechsim.numerics.complementarity import complementary


@pytest.mark.parametrize("seed", range(40))
def test_a_solution_satisfies_the_three_conditions(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 6))
    rows = rng.normal(size=(count, rng.integers(1, count + 1)))
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    # in the range of the rows, so that a solution exists though the matrix may be singular
    constant = rows @ rng.normal(size=rows.shape[1]) * 10.0 ** rng.uniform(-6.0, 6.0)
    z = complementary(rows @ rows.T, constant)
    assert z is not None
    slack = rows @ rows.T @ z + constant
    scale = np.abs(constant).max() + z.max()
    assert z.min() >= 0.0
    assert slack.min() >= -1e-9 * scale
    assert np.abs(z * slack).max() <= 1e-9 * scale**2


@pytest.mark.parametrize("signs", [*product((-1.0, 1.0), repeat=2)])
def test_two_independent_gaps_press_where_they_would_close(signs):
    assert complementary(np.eye(2), np.array(signs)) == pytest.approx([max(-sign, 0.0) for sign in signs])


@pytest.mark.parametrize("excess", [1e-12, 1e-3, 1.0])
def test_opposed_gaps_that_both_close_have_no_solution(excess):
    opposed = np.array([[1.0, -1.0], [-1.0, 1.0]])
    assert complementary(opposed, np.array([-1.0, 1.0])) is not None
    assert complementary(opposed, np.array([-1.0 - excess, 1.0])) is None


def test_a_gap_that_no_force_moves_stays_closed_only_if_it_does_not_close():
    assert complementary(np.zeros((1, 1)), np.array([-1.0])) is None
    assert complementary(np.zeros((1, 1)), np.array([1.0])) == pytest.approx([0.0])
