"""Gauss-Legendre collocation on equations with closed solutions."""

import numpy as np
import pytest

from mechsim.numerics.gauss_collocation import GaussCollocation, collocated, rule


def oscillator(frequency):
    return lambda times, states: np.stack([states[:, 1], -(frequency**2) * states[:, 0]], 1)


def integrated(derivatives, state, end, rtol=3e-13):
    """Return the solver at the end and the pieces of the solution."""
    scale, origin = np.ones(len(state)), np.zeros(len(state))
    solver = GaussCollocation(derivatives, 0.0, np.array(state), end, rtol, scale, origin)
    pieces = []
    while solver.status == "running":
        message = solver.step()
        if not message:
            pieces.append(solver.dense_output())
    return solver, pieces


@pytest.mark.long
def test_an_oscillator_is_accurate_over_a_hundred_periods():
    end, rtol = 200.0 * np.pi, 3e-14
    solver, pieces = integrated(oscillator(1.0), [1.0, 0.0], end, rtol)
    # errors of steps add up, and an oscillation does not amplify them; measured 4e-13 to 1.8e-12
    allowed = rtol * len(pieces)
    assert solver.t == end
    assert solver.y == pytest.approx([1.0, 0.0], abs=allowed)
    times = np.linspace(0.0, end, 2001)
    ends = np.array([piece.start + piece.duration for piece in pieces])
    k = np.minimum(np.searchsorted(ends, times), len(ends) - 1)
    values = np.array([pieces[i](t)[0] for i, t in zip(k, times, strict=True)])
    assert np.abs(values - np.cos(times)).max() <= allowed


@pytest.mark.parametrize("nodes", [2, 3, 4])
def test_the_error_of_a_step_has_order_two_nodes_plus_one(nodes):
    def error(duration):
        guess = np.tile([1.0, 0.0], (nodes, 1))
        result = collocated(oscillator(1.0), 0.0, np.array([1.0, 0.0]), duration, guess, np.full(2, 1e-15))
        return np.abs(result[0](duration) - [np.cos(duration), -np.sin(duration)]).max()

    order = np.log2(error(0.5) / error(0.25))
    assert 2 * nodes + 0.5 <= order <= 2 * nodes + 2.5


def test_a_step_too_long_for_its_iteration_is_rejected():
    guess = np.tile([1.0, 0.0], (24, 1))
    assert collocated(oscillator(1e3), 0.0, np.array([1.0, 0.0]), 0.1, guess, np.full(2, 1e-13)) is None


def test_a_looser_tolerance_takes_fewer_steps():
    coarse, fine = (len(integrated(oscillator(1.0), [1.0, 0.0], 50.0, rtol)[1]) for rtol in (1e-6, 1e-13))
    assert coarse < fine


def test_a_kink_in_time_is_resolved():
    """y' = |t - 0.3|: the integral has a kink in its second derivative."""
    rtol = 3e-13
    solver, _ = integrated(lambda times, _: np.abs(times - 0.3)[:, None], [0.0], 1.0, rtol)
    # the estimate of a step's error presumes smoothness: over a kink measured up to 31 rtol
    assert solver.y == pytest.approx([0.5 * (0.3**2 + 0.7**2)], abs=100.0 * rtol)


def test_jumps_before_the_first_node_of_a_step_and_after_its_last_are_resolved():
    """y' = 1 until an instant, -1 after it: at the end of the run twice the instant less the duration."""
    for instant in np.linspace(0.3, 0.9, 61):
        solver, _ = integrated(
            lambda times, _, t=instant: np.where(times < t, 1.0, -1.0)[:, None], [0.0], 1.0
        )
        assert solver.y == pytest.approx([2.0 * instant - 1.0], abs=1e-11)


def test_steps_end_before_states_without_derivative():
    def derivatives(times, states):
        return np.where(states < 1.0, 1.0, np.nan)

    solver, _ = integrated(derivatives, [0.0], 5.0)
    assert solver.status == "failed"
    assert 1.0 - 1e-9 < solver.y[0] < 1.0


def test_extrapolation_continues_a_smooth_solution():
    _, pieces = integrated(oscillator(1.0), [1.0, 0.0], 5.0)
    piece = pieces[2]
    time = piece.start + 1.3 * piece.duration
    assert piece.beyond(np.array([time]))[0] == pytest.approx([np.cos(time), -np.sin(time)], abs=1e-4)


@pytest.mark.parametrize("count", [2, 12, 24])
def test_a_rule_integrates_polynomials_of_its_degree(count):
    powers = np.arange(2 * count)
    values = rule(count).to_end @ rule(count).nodes[:, None] ** powers
    assert values == pytest.approx((1.0 - (-1.0) ** (powers + 1)) / (powers + 1), abs=1e-13)


def test_a_stiff_equation_needs_few_steps():
    """y' = -l (y - cos t) - sin t, which relaxes to cos t; Prothero and Robinson's problem."""
    decay, start = 1e7, 0.0

    def derivatives(times, states):
        return -decay * (states - np.cos(times)[:, None]) - np.sin(times)[:, None]

    def jacobians(times, states):
        return np.full((*states.shape, 1), -decay)

    solver = GaussCollocation(
        derivatives, 0.0, np.array([start]), 10.0, 3e-13, np.ones(1), np.zeros(1), jacobians=jacobians
    )
    steps = 0
    while solver.status == "running":
        assert not solver.step()
        steps += 1
    assert solver.y == pytest.approx([np.cos(10.0)], abs=1e-12)
    # measured 60; an explicit method takes ten million
    assert steps < 100
