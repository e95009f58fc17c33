"""Linear complementarity problems against their three conditions, and frictions by hand."""

from itertools import product

import numpy as np
import pytest

from mechsim.numerics.complementarity import balanced_friction, complementary


@pytest.mark.parametrize("seed", range(40))
def test_a_solution_satisfies_the_three_conditions(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 6))
    rows = rng.normal(size=(count, rng.integers(1, count + 1)))
    rows /= np.linalg.norm(rows, axis=1)[:, None]
    # in the range of the rows, so that a solution exists though the matrix may be singular
    constant = rows @ rng.normal(size=rows.shape[1]) * 10.0 ** rng.uniform(-6.0, 6.0)
    z = complementary(rows @ rows.T, constant)
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


def balanced(base, response):
    """Return the answer for x_k = abs(base_k + sum of response_kj x_j)."""
    count = len(base)
    terms, changes = np.zeros((1, count, 1, 3)), np.zeros((1, count, 1, 3, count))
    terms[0, :, 0, 0], changes[0, :, 0, 0] = base, response
    friction, radius, solutions = balanced_friction(np.zeros((1, count)), terms, changes)
    return friction[0], radius[0], solutions[0]


def test_a_single_friction_has_its_smaller_solution_or_none():
    # x = |1 - 2 x|: 1/3, and 1, from which a load that is off grows
    friction, radius, solutions = balanced([1.0], [[-2.0]])
    assert (friction[0], radius, solutions) == (pytest.approx(1 / 3, rel=1e-14), 2.0, 1)
    assert balanced([1.0], [[2.0]])[2] == 0


@pytest.mark.parametrize(("a", "expected"), [(0.9, 1), (1.1, 2)])
def test_frictions_that_unload_each_other_have_two_solutions_beyond_the_contraction(a, expected):
    # x = |1 - a y|, y = |1 - a x|: below 1 both 1 / (1 + a); above, that is unstable, and
    # (1 + a) / (1 + a^2), (a - 1) / (1 + a^2) either way round are stable
    friction, _, solutions = balanced([1.0, 1.0], [[0.0, -a], [-a, 0.0]])
    assert solutions == expected
    if expected == 1:
        assert friction == pytest.approx(np.full(2, 1 / (1 + a)), rel=1e-13)


@pytest.mark.parametrize("a", [0.5, 3.0])
def test_a_friction_that_loads_what_unloads_it_is_unique_at_any_size(a):
    # x = |10 - a y|, y = |1 + a x| with 10 > a y: x = (10 - a) / (1 + a^2)
    friction, radius, solutions = balanced([10.0, 1.0], [[0.0, -a], [a, 0.0]])
    x = (10 - a) / (1 + a**2)
    assert radius == pytest.approx(a)
    assert solutions == 1
    assert friction == pytest.approx([x, 1 + a * x], rel=1e-13)
