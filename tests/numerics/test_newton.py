"""Newton's method on many configurations with known roots."""

import numpy as np
import pytest

from mechsim.numerics.newton import LinearEquations, NewtonSettings, newton, root
from mechsim.numerics.rank import least_norm


@pytest.mark.parametrize("expected", [1.0 / 3.0, -np.pi, 2.0**0.5 * 1e-200])
@pytest.mark.parametrize(
    "shape",
    [lambda x: x, lambda x: x**3, np.sign, lambda x: np.arctan(1e9 * x)],
    ids=["line", "cube", "step", "steep"],
)
def test_a_root_is_accurate_to_rounding(expected, shape):
    def function(x):
        return float(shape((x - expected) / expected))

    low, high = sorted((0.1 * expected, 2.3 * expected))
    assert abs(root(function, low, high) - expected) <= 1e-15 * abs(expected)


class Square:
    """x**2 = c, one equation per configuration; counts linearisations."""

    def __init__(self, c):
        self.c, self.linearised = np.asarray(c), 0

    def linearise(self, x):
        self.linearised += 1
        return LinearEquations((x**2 - self.c)[:, None], 2.0 * x[:, None, None])

    def retract(self, x, step):
        return x + step[:, 0]


def test_each_configuration_converges_to_its_own_root():
    result = newton(Square([2.0, 9.0, 1e-4]), np.array([1.0, 4.0, 0.02]), NewtonSettings())
    np.testing.assert_allclose(result.q, [2.0**0.5, 3.0, 0.01], rtol=2e-15)
    assert result.residual.max() < 1e-15


def test_a_configuration_beyond_max_displacement_is_abandoned():
    result = newton(Square([2.0, 9.0]), np.array([1.0, 4.0]), NewtonSettings(max_displacement=0.6))
    assert result.displacement.tolist() == [pytest.approx(0.5 + 0.0833 + 0.0025, abs=1e-4), np.inf]
    np.testing.assert_allclose(result.q, [2.0**0.5, 4.0], rtol=1e-15)


def test_a_long_step_is_shortened():
    result = newton(Square([9.0]), np.array([1.0]), NewtonSettings(max_iterations=3, max_step=0.5))
    assert result.q.tolist() == [2.5]
    assert result.displacement.tolist() == [1.5]


def test_iterations_stop_at_the_tolerance_or_at_rounding():
    few, all_steps = Square([2.0]), Square([2.0])
    newton(few, np.array([1.5]), NewtonSettings(tolerance=1e-2))
    newton(all_steps, np.array([1.5]), NewtonSettings(max_iterations=40))
    assert few.linearised == 2
    assert 4 <= all_steps.linearised <= 6


def test_a_last_short_step_need_not_be_verified():
    system = Square([2.0])
    result = newton(system, np.array([1.4143]), NewtonSettings(tolerance=1e-7, verify=False))
    assert system.linearised == 1
    np.testing.assert_allclose(result.q, [2.0**0.5], atol=1e-8)
    np.testing.assert_allclose(result.unverified, result.q[:, None] - 1.4143, atol=1e-15)


def test_a_rank_deficient_system_is_solved_by_least_norm():
    class Circle:
        def linearise(self, x):
            return LinearEquations(((x**2).sum(1) - 1.0)[:, None], 2.0 * x[:, None])

        def retract(self, x, step):
            return x + step

    result = newton(Circle(), np.array([[3.0, 4.0]]), NewtonSettings(), least_norm)
    np.testing.assert_allclose(result.q, [[0.6, 0.8]], rtol=1e-15)
