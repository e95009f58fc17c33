"""Jets have both derivatives after every operation, compared with fifty digits, and the values of arrays."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from mpmath import mp

from mechsim.kinematics.vector_method import vectors
from mechsim.numerics import jets
from mechsim.numerics.jets import Jet

EPS = np.finfo(np.float64).eps
rates = st.integers(-3000, 3000).map(lambda value: (value + 0.37) * 1e-3)
sizes = st.integers(200, 3000).map(lambda value: (value + 0.41) * 1e-3)
series = st.tuples(sizes, rates, rates)

IN_NUMPY = SimpleNamespace(sqrt=np.sqrt, sin=np.sin, cos=np.cos, exp=np.exp, arctan2=np.arctan2)
IN_NUMPY.__dict__.update(log=np.log, tan=np.tan, asin=np.arcsin, acos=np.arccos, atan=np.arctan)
IN_DIGITS = SimpleNamespace(sqrt=mp.sqrt, sin=mp.sin, cos=mp.cos, exp=mp.exp, arctan2=mp.atan2)
IN_DIGITS.__dict__.update(log=mp.log, tan=mp.tan, asin=mp.asin, acos=mp.acos, atan=mp.atan)
# what a formula may be made of; f is the library of functions
FORMULAS = {
    "sum": lambda f, x, y: 3.0 + x + y - 2.0 - (y - x) + (1.5 - x),
    "product": lambda f, x, y: x * y * 2.0 - -x * x,
    "square": lambda f, x, y: (x + y) ** 2,
    "quotient": lambda f, x, y: x / y + 2.0 / x - y / 3.0,
    "root": lambda f, x, y: f.sqrt(x * x + y),
    "sine": lambda f, x, y: f.sin(x * y),
    "cosine": lambda f, x, y: f.cos(x + y),
    "exponential": lambda f, x, y: f.exp(0.5 * x),
    "logarithm": lambda f, x, y: f.log(x * x + 1.0),
    "tangent": lambda f, x, y: f.tan(0.2 * f.sin(x)),
    "inverse sine": lambda f, x, y: f.asin(0.5 * f.sin(x * y)),
    "inverse cosine": lambda f, x, y: f.acos(0.5 * f.cos(x + y)),
    "inverse tangent": lambda f, x, y: f.atan(x - y),
    "third power": lambda f, x, y: (x - y) ** 3.0,
    "inverse root": lambda f, x, y: x**-0.5,
    "varying power": lambda f, x, y: x ** (0.1 * y) + 2.0**y,
    "direction": lambda f, x, y: f.arctan2(y, x - 1.0),
}


def jet(values):
    return Jet(*(np.array([value]) for value in values))


@pytest.mark.long
@pytest.mark.parametrize("name", FORMULAS)
@given(series, series)
def test_value_and_rates_agree_with_fifty_digits(name, x, y):
    formula = FORMULAS[name]
    with mp.workdps(50):

        def of_time(t):
            u, v = (mp.mpf(a) + mp.mpf(b) * t + mp.mpf(c) * t * t / 2 for a, b, c in (x, y))
            return formula(IN_DIGITS, u, v)

        value, first, half_second = (float(computed) for computed in mp.taylor(of_time, 0, 2))
    result = formula(IN_NUMPY, jet(x), jet(y))
    assume(name != "direction" or np.hypot(x[0] - 1.0, y[0]) > 0.1)
    scale = 1.0 + max(abs(value), abs(first), abs(2.0 * half_second))
    for computed, expected in (
        (result.value, value),
        (result.rate, first),
        (result.second, 2.0 * half_second),
    ):
        assert abs(computed[0] - expected) <= 1e-11 * scale


@given(st.lists(series, min_size=6, max_size=6))
def test_vector_products_have_the_rates_of_their_components(six):
    stacked = [
        Jet(*(np.array([quantity[i] for quantity in three])[:, None] for i in range(3)))
        for three in (six[:3], six[3:])
    ]
    a, b = stacked
    components = [[jet(quantity) for quantity in three] for three in (six[:3], six[3:])]
    (a0, a1, a2), (b0, b1, b2) = components
    by_parts = {
        "dot": a0 * b0 + a1 * b1 + a2 * b2,
        "norm": np.sqrt(a0 * a0 + a1 * a1 + a2 * a2),
        "z of cross": a0 * b1 - a1 * b0,
    }
    result = {"dot": vectors.dot(a, b), "norm": vectors.norm(a), "z of cross": vectors.cross(a, b)[2]}
    for name, expected in by_parts.items():
        for quantity in ("value", "rate", "second"):
            difference = getattr(result[name], quantity) - getattr(expected, quantity)
            assert np.abs(difference).max() <= 1e-12 * (1.0 + np.abs(getattr(expected, quantity)).max())


def test_a_formula_gives_the_same_positions_on_arrays_and_on_jets():
    angles = np.linspace(0.1, 6.0, 50)
    centre, axis = vectors.column((0.02, -0.03, 0.01)), vectors.column((0.6, 0.0, 0.8))

    def point(angle):
        pin = 0.013 * vectors.rotate(vectors.column((0.0, 1.0, 0.0)), vectors.column((1.0, 0.0, 0.0)), angle)
        return vectors.circle_sphere(centre, axis, 0.027, pin, 0.04, 1)

    assert np.isfinite(point(angles)).all()
    assert (point(Jet(angles, 1.0, 0.0)).value == point(angles)).all()


def test_a_numerical_root_has_both_derivatives():
    time = np.linspace(0.0, 1.0, 5)
    offset = Jet(np.sin(time), np.cos(time), -np.sin(time))
    # t3 + t = offset
    result = np.array([np.roots([1.0, 0.0, 1.0, -value]).real[-1] for value in offset.value])
    t = jets.jet_root(lambda t: t * t * t + t - offset, result, 3.0 * result**2 + 1.0)
    rate = offset.rate / (3.0 * result**2 + 1.0)
    second = (offset.second - 6.0 * result * rate**2) / (3.0 * result**2 + 1.0)
    assert (t.value == result).all()
    assert np.abs(t.rate - rate).max() <= 8 * EPS
    assert np.abs(t.second - second).max() <= 32 * EPS


def test_a_function_without_a_rule_is_rejected():
    with pytest.raises(TypeError):
        np.tanh(jet((1.0, 2.0, 3.0)))


def test_the_angle_of_a_jet_takes_complex_steps():
    # d/dy atan2(y, x) = x / (x2 + y2), from fifty digits
    x, y = 0.3, -0.7
    sine = Jet(jets.stepped(np.array([y]), np.ones(1)), np.zeros(1), np.zeros(1))
    angle = np.arctan2(sine, Jet(np.array([x]), np.zeros(1), np.zeros(1)))
    exact = mp.mpf(x) / (mp.mpf(x) ** 2 + mp.mpf(y) ** 2)
    assert angle.value.real[0] == pytest.approx(float(mp.atan2(mp.mpf(y), mp.mpf(x))), rel=1e-15)
    assert jets.change_of(angle.value)[0] == pytest.approx(float(exact), rel=1e-14)
