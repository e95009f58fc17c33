"""Error norms, orders, Pareto fronts and choices for data with known results."""

import numpy as np
import pytest

from mechsim.numerics.arrays import rms, worst
from mechsim.numerics.convergence import (
    cheapest,
    half_extent,
    observed_order,
    pareto,
    plausible_order,
)

STEPS = np.array([10.0, 20.0, 50.0, 100.0, 1000.0])


def test_error_norms_of_known_data():
    assert worst([3.0, -4.0]) == 4.0
    assert rms([3.0, -4.0]) == pytest.approx(np.sqrt(12.5))
    assert rms([3e200, -4e200]) == pytest.approx(np.sqrt(12.5) * 1e200)
    assert worst([]) == rms([]) == rms([0.0, 0.0]) == 0.0


def test_a_nan_is_an_infinite_error():
    assert worst([0.0, np.nan]) == np.inf
    assert rms([0.0, np.nan]) == np.inf


def test_half_extent_belongs_to_the_longest_path():
    path = np.array([[0.0, 1.0, 0.0], [3.0, 5.0, 0.0]])
    assert half_extent([path, 0.1 * path]) == 2.0


@pytest.mark.parametrize("order", [1.0, 2.0, 4.0])
def test_a_pure_power_has_its_order(order):
    result = observed_order(STEPS, 7.0 * STEPS**-order)
    assert (result.order, result.low, result.high) == pytest.approx((order, order, order))
    assert result.count == len(STEPS)


def test_steps_may_be_inverse_step_sizes_below_one():
    result = observed_order(1e-3 * STEPS, STEPS**-2.0)
    assert (result.order, result.count) == (pytest.approx(2.0), len(STEPS))


def test_order_does_not_depend_on_the_sequence_of_points():
    forward = observed_order(STEPS, STEPS**-3.0 * [1, 2, 1, 2, 1])
    backward = observed_order(STEPS[::-1], (STEPS**-3.0 * [1, 2, 1, 2, 1])[::-1])
    assert forward.order == pytest.approx(backward.order)
    assert forward.low < 3.0 < forward.high


def test_points_beyond_floor_and_ceiling_do_not_change_the_order():
    error = np.maximum(STEPS**-4.0, 1e-7)
    error[0] = 1.0
    naive, bounded = observed_order(STEPS, error), observed_order(STEPS, error, floor=1e-7, ceiling=0.5)
    assert bounded.order == pytest.approx(4.0)
    assert abs(naive.order - 4.0) > 0.5


@pytest.mark.parametrize("errors", [[np.nan] * 5, [1.0, 0.0, np.inf, np.nan, 0.0]])
def test_an_order_needs_two_points(errors):
    assert observed_order(STEPS, errors) is None


def test_the_order_of_two_runs_is_clipped_to_one_to_four():
    assert plausible_order(8.0, 1.0, 2.0) == pytest.approx(3.0)
    assert plausible_order(8e-9, 1e-9, 2.0) == pytest.approx(3.0)
    assert plausible_order(1e9, 1.0, 2.0) == 4.0
    assert plausible_order(1.0, 2.0, 2.0) == 1.0
    for nothing in (0.0, np.nan, np.inf):
        assert plausible_order(nothing, 1.0, 2.0) == plausible_order(1.0, nothing, 2.0) == 1.0


def test_the_front_contains_the_undominated_points():
    cost = [1.0, 2.0, 2.0, 3.0, 4.0, 5.0, np.nan, 0.5]
    error = [1e-1, 1e-3, 1e-2, 1e-3, 1e-5, np.nan, 1e-9, np.inf]
    assert pareto(cost, error).tolist() == [0, 1, 4]


def test_the_front_equals_a_brute_force_search():
    cost, error = np.random.default_rng(3).random((2, 200))
    beaten = ((cost <= cost[:, None]) & (error <= error[:, None])).sum(1) > 1
    assert sorted(pareto(cost, error)) == np.flatnonzero(~beaten).tolist()
    assert (np.diff(cost[pareto(cost, error)]) > 0.0).all()


def test_the_cheapest_point_meets_the_error_limit():
    cost, error = [1.0, 2.0, 3.0, np.nan], [1e-2, 1e-4, 1e-4, 0.0]
    assert cheapest(cost, error, 1e-3) == 1
    assert cheapest(cost, error, 1e-2) == 0
    assert cheapest(cost, error, 1e-5) is None
    assert cheapest([1.0], [np.nan], 1.0) is None
