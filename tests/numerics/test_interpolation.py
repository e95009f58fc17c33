"""Smooth interpolation of tables over time."""

import numpy as np

from mechsim.numerics.collocation import quintic_spline

TIME = np.array([0.0, 0.3, 0.5, 1.1, 1.4, 2.0, 2.2])


def test_a_quintic_spline_reproduces_a_polynomial_of_degree_five():
    power = np.polynomial.Polynomial([1.0, -2.0, 0.5, 0.3, -0.7, 0.2])
    times = np.linspace(0.0, 2.2, 50)
    result = quintic_spline("it", TIME, power(TIME))(times)
    for order, values in enumerate(result):
        np.testing.assert_allclose(values, power.deriv(order)(times) if order else power(times), atol=1e-11)
