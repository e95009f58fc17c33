import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mechsim.numerics import balls
from mechsim.numerics.balls import Ball, ball

DIGITS = 60
numbers = st.floats(-1e6, 1e6).filter(lambda x: x == 0.0 or abs(x) > 1e-100)
radii = st.floats(0.0, 1e3)


def contains(result, exact):
    """Whether balls contain exact values of mpmath, compared in 60 digits."""
    with mpmath.workdps(DIGITS):
        pairs = zip(result.mid.ravel(), result.rad.ravel(), np.ravel(exact), strict=True)
        return all(abs(mpmath.mpf(float(mid)) - value) <= mpmath.mpf(float(rad)) for mid, rad, value in pairs)


def corners(a, b):
    """Yield exact numbers of two balls: midpoints and ends."""
    for item in (-1, 0, 1):
        for other in (-1, 0, 1):
            yield (
                mpmath.mpf(float(a.mid)) + item * mpmath.mpf(float(a.rad)),
                mpmath.mpf(float(b.mid)) + other * mpmath.mpf(float(b.rad)),
            )


OPERATIONS = {
    "sum": lambda x, y: x + y,
    "difference": lambda x, y: x - y,
    "product": lambda x, y: x * y,
}


@pytest.mark.parametrize("name", OPERATIONS)
@given(numbers, radii, numbers, radii)
def test_operations_contain_their_exact_results(name, a, ra, b, rb):
    first, second = Ball(np.array(a), np.array(ra)), Ball(np.array(b), np.array(rb))
    result = OPERATIONS[name](first, second)
    with mpmath.workdps(DIGITS):
        for x, y in corners(first, second):
            assert contains(result, OPERATIONS[name](x, y))


@given(numbers, radii)
def test_reciprocals_and_roots_contain_the_exact_results(a, ra):
    value = Ball(np.array(a), np.array(ra))
    with mpmath.workdps(DIGITS):
        ends = [x for x, _ in corners(value, ball(0.0))]
        reciprocal, root = value.reciprocal(), value.sqrt()
        if min(ends) <= 0 <= max(ends):
            assert reciprocal.rad == np.inf
        else:
            assert all(contains(reciprocal, 1 / x) for x in ends)
        if min(ends) <= 0:
            assert root.rad == np.inf
        else:
            assert all(contains(root, mpmath.sqrt(x)) for x in ends)


@pytest.mark.parametrize("scale", [1e-150, 1e160, 1e300])
def test_reciprocals_and_roots_do_not_overflow(scale):
    value = Ball(np.array(scale), np.array(0.1 * scale))
    with mpmath.workdps(DIGITS):
        for end, _ in corners(value, ball(0.0)):
            assert contains(value.reciprocal(), 1 / end)
            assert contains(value.sqrt(), mpmath.sqrt(end))


@given(st.floats(-1e5, 1e5), st.floats(0.0, 4.0), st.floats(-1.0, 1.0))
def test_sine_and_cosine_contain_the_exact_results(angle, radius, fraction):
    sine, cosine = Ball(np.array(angle), np.array(radius)).sin_cos()
    with mpmath.workdps(DIGITS):
        x = mpmath.mpf(angle) + mpmath.mpf(fraction) * mpmath.mpf(radius)
        assert contains(sine, mpmath.sin(x))
        assert contains(cosine, mpmath.cos(x))


def test_sines_of_exact_angles_have_tight_bounds():
    angles = np.concatenate([np.linspace(-7.0, 7.0, 2001), np.pi / 4 * np.arange(-9, 10)])
    sine, cosine = ball(angles).sin_cos()
    with mpmath.workdps(DIGITS):
        assert contains(sine, [mpmath.sin(mpmath.mpf(float(x))) for x in angles])
        assert contains(cosine, [mpmath.cos(mpmath.mpf(float(x))) for x in angles])
    assert max(sine.rad.max(), cosine.rad.max()) < 1e-14
    assert ball(2e6).sin_cos()[0].rad >= 1.0


def test_matrix_products_contain_exact_products():
    rng = np.random.default_rng(3)
    a, b = rng.standard_normal((2, 7, 3, 3)) * 10.0 ** rng.integers(-8, 8, (2, 7, 3, 3))
    result = ball(a) @ ball(b)
    with mpmath.workdps(DIGITS):
        for i in range(7):
            assert contains(result[i], np.array((mpmath.matrix(a[i]) * mpmath.matrix(b[i])).tolist()))


def test_a_radius_without_rounding_error_is_rejected(monkeypatch):
    """The check by 60 digits rejects an arithmetic that does not round outward."""
    monkeypatch.setattr(balls, "ROUNDOFF", 0.0)
    monkeypatch.setattr(balls, "OUTWARD", 1.0)
    with mpmath.workdps(DIGITS):
        product = ball(0.1) * ball(0.1)
        assert not contains(product, mpmath.mpf(0.1) ** 2)
        total = ball(0.1) + ball(0.2)
        assert not contains(total, mpmath.mpf(0.1) + mpmath.mpf(0.2))


@given(st.floats(-800.0, 800.0), st.floats(0.0, 0.6))
def test_exponentials_contain_the_exact_results_or_have_no_bound(a, ra):
    value = Ball(np.array(a), np.array(ra))
    with mpmath.workdps(DIGITS):
        result = np.exp(value)
        assert all(contains(result, mpmath.exp(x)) for x, _ in corners(value, ball(0.0)))
    if abs(a) < 600.0 and ra < 1e-3:
        assert result.rad <= (3.0 * ra + 1e-12) * result.mid


@given(st.floats(-9.0, 9.0), st.floats(0.0, 0.1), st.integers(1, 9))
def test_powers_contain_the_exact_results(a, ra, exponent):
    value = Ball(np.array(a), np.array(ra))
    with mpmath.workdps(DIGITS):
        assert all(contains(value**exponent, x**exponent) for x, _ in corners(value, ball(0.0)))


def test_a_power_without_a_bound_is_rejected():
    with pytest.raises(TypeError, match=r"no bound for the power 0\.3"):
        ball(2.0) ** 0.3


def test_numpy_functions_contain_the_exact_results():
    value = Ball(np.array([0.3, 0.7]), np.array([0.0, 0.1]))
    with mpmath.workdps(DIGITS):
        for function, exact in ((np.sin, mpmath.sin), (np.cos, mpmath.cos), (np.tan, mpmath.tan)):
            assert contains(function(value), [exact(mpmath.mpf(0.3)), exact(mpmath.mpf(0.75))])
    assert contains(np.array([2.0, 3.0]) * value, [mpmath.mpf(0.3) * 2, mpmath.mpf(0.7) * 3])
    with pytest.raises(TypeError):
        np.arctan(value)
