"""Polynomials through nodes, piecewise polynomials and extrapolation, compared with numpy's."""

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from mechsim.numerics.balls import Ball, ball
from mechsim.numerics.collocation import (
    Interpolant,
    Piecewise,
    extrapolated,
    integral,
    nodes_between,
    quintic_spline,
    through,
)
from mechsim.numerics.newton import roots

CUBIC = Polynomial([0.3, -1.0, 0.5, 2.0])
RANDOM = np.random.default_rng(3)


def table(nodes):
    return np.column_stack([CUBIC(nodes), np.sin(nodes)])


def test_interpolants_reproduce_a_polynomial():
    nodes = np.sort(RANDOM.uniform(2.0, 3.0, 6))
    s = np.linspace(2.0, 3.0, 11)
    fit = through(nodes, CUBIC(nodes)[:, None])
    for polynomial, exact in ((fit, CUBIC), (fit.derivative(), CUBIC.deriv())):
        assert polynomial.evaluate(s)[:, 0] == pytest.approx(exact(s), rel=1e-11)
    assert fit.value_at(2.5)[0] == pytest.approx(CUBIC(2.5), rel=1e-12)
    # Chebyshev's points have weights of their own
    points, weights = nodes_between(2.0, 3.0, 6)
    assert Interpolant(points, CUBIC(points)[:, None], weights).evaluate(s) == pytest.approx(
        through(points, CUBIC(points)[:, None]).evaluate(s), rel=1e-12
    )


def test_extrapolation_is_exact_for_a_sufficient_degree():
    x, ahead = np.linspace(-1.0, 1.0, 9), np.array([1.5, 2.0])
    assert extrapolated(x, CUBIC(x)[:, None], 3, ahead)[:, 0] == pytest.approx(CUBIC(ahead), rel=1e-12)
    assert np.abs(extrapolated(x, CUBIC(x)[:, None], 2, ahead)[:, 0] - CUBIC(ahead)).min() > 1.0


def test_the_integral_of_a_polynomial_is_exact():
    x = np.sort(RANDOM.uniform(0.0, 2.0, 7))
    exact = CUBIC.integ()
    assert integral(x, CUBIC(x)) == pytest.approx(exact(x) - exact(x[0]), rel=1e-11)


def test_a_parameter_at_a_junction_belongs_to_the_next_polynomial():
    forward, backward = (through(np.linspace(*ends, 9), np.zeros((9, 1))) for ends in ((0, 1), (2, 1)))
    pieces = Piecewise([forward, backward])
    assert pieces.segment_at(0.5) is forward
    for s in (1.0, 1.0 - 1e-13, 1.5, 7.0):
        assert pieces.segment_at(s) is backward
    assert pieces.segment_at(1.0 - 1e-9) is pieces.segment_at(-3.0) is forward
    result = {id(segment): index.tolist() for segment, index in pieces.groups(np.array([1.2, 0.1, 1.0]))}
    assert result == {id(forward): [1], id(backward): [0, 2]}


def test_one_component_of_each_parameter_has_roots_of_its_own():
    nodes = nodes_between(0.0, 2.0, 3)[0]
    pieces = Piecewise(
        [through(nodes + low, np.stack([nodes + low - 1.0, 3.0 - nodes - low], 1)) for low in (0.0, 2.0)]
    )
    assert pieces.components(np.array([3.5, 0.5, 0.5]), np.array([0, 1, 0])) == pytest.approx(
        [2.5, 2.5, -0.5]
    )
    columns = np.array([1, 0])
    solutions = roots(pieces.components, np.array([2.5, 0.2]), np.array([3.7, 1.7]), columns)
    assert solutions == pytest.approx([3.0, 1.0], abs=1e-14)


def test_piecewise_polynomials_keep_the_order_of_parameters():
    pieces = Piecewise(
        [through(nodes, table(nodes)) for nodes in (np.linspace(0, 1, 12), np.linspace(1, 2, 12))]
    )
    s = RANDOM.uniform(0.0, 2.0, 20)
    assert pieces.evaluate(s) == pytest.approx(table(s), abs=1e-10)
    rates = np.column_stack([CUBIC.deriv()(s), np.cos(s)])
    assert pieces.derivative().evaluate(s) == pytest.approx(rates, abs=1e-8)


def test_a_spline_of_balls_contains_its_values_and_derivatives():
    time = np.linspace(0.0, 2.0, 25)
    spline = quintic_spline("a table", time, np.sin(5.0 * time))
    rng = np.random.default_rng(0)
    spans = Ball(rng.uniform(0.1, 1.9, 200), rng.uniform(0.0, 0.1, 200))
    enclosed = spline(spans)
    for _ in range(20):
        inside = spline(spans.mid + spans.rad * rng.uniform(-1.0, 1.0, 200))
        for value, bounds in zip(inside, enclosed, strict=True):
            assert (np.abs(value - bounds.mid) <= bounds.rad).all()
    thin = spline(ball(spans.mid))
    assert all(bounds.rad.max() < 1e-10 for bounds in thin)


TIME = np.array([0.0, 0.3, 0.5, 1.1, 1.4, 2.0, 2.2])


def test_a_quintic_spline_reproduces_a_polynomial_of_degree_five():
    power = np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.3, -0.7, 0.2])
    times = np.linspace(0.0, 2.2, 50)
    result = quintic_spline("it", TIME, power(TIME))(times)
    for order, values in enumerate(result):
        np.testing.assert_allclose(values, power.deriv(order)(times) if order else power(times), atol=1e-11)
