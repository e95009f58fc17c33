"""Motion laws as text: their values, exact rates, and invalid texts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mechsim.errors import InputError
from mechsim.io.law_text import parse_motion_law, time_function

TIMES = np.linspace(0.1, 0.9, 17)


def made(text, unit="rad", start=0.3):
    return parse_motion_law(text, "arm", unit, lambda: start)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("600rpm", "rad", 0.3 + 20 * np.pi * TIMES),
        ("-30 deg/s", "rad", 0.3 - np.pi / 6 * TIMES),
        ("2.5rad/s", "rad", 0.3 + 2.5 * TIMES),
        ("20mm/s", "m", 0.3 + 0.02 * TIMES),
        ("30deg", "rad", np.full_like(TIMES, np.pi / 6)),
        ("12 mm", "m", np.full_like(TIMES, 0.012)),
        ("30deg*sin(2*pi*0.6*t)", "rad", np.pi / 6 * np.sin(1.2 * np.pi * TIMES)),
        ("0.4*(1-cos(2*pi*t))", "rad", 0.4 * (1 - np.cos(2 * np.pi * TIMES))),
        ("10mm + 2mm*t/1s", "m", 0.01 + 0.002 * TIMES),
        ("20 mm/s * t", "m", 0.02 * TIMES),
        ("600rpm*t", "rad", 20 * np.pi * TIMES),
        ("30deg*sin(360deg*t)", "rad", np.pi / 6 * np.sin(2 * np.pi * TIMES)),
        ("5mm*sin(2*pi*3Hz*t)", "m", 0.005 * np.sin(6 * np.pi * TIMES)),
        ("sqrt((3mm)**2 + (4mm*t)**2)", "m", np.hypot(0.003, 0.004 * TIMES)),
        ("atan2(3mm*t, 1mm)", "rad", np.arctan(3 * TIMES)),
        ("1e-3*t + 2e1deg*t", "rad", (1e-3 + np.pi / 9) * TIMES),
        ("min(10deg, 20deg*t)", "rad", np.minimum(10, 20 * TIMES) * np.pi / 180),
    ],
)
def test_a_motion_law_gives_the_position_of_its_driver(text, unit, value):
    np.testing.assert_allclose(made(text, unit).state(TIMES)[0], value, rtol=1e-14)


def complex_step(text, time):
    """Return value and rate of an expression by a complex step, evaluated by Python."""
    names = {item: getattr(np, item) for item in ("sin", "cos", "tan", "exp", "log", "sqrt", "pi")}
    names |= {"asin": np.arcsin, "acos": np.arccos, "atan": np.arctan}
    result = eval(text.replace("/1rad", ""), {**names, "t": time + 1e-30j})
    return result.real, result.imag / 1e-30


@st.composite
def expressions(draw, depth=3):
    """Draw an expression of t that is finite and smooth from 0.1 to 0.9."""
    if depth == 0:
        return draw(st.sampled_from(["t", "0.7", "(t + 0.3)", "(2*t)"]))
    item = draw(expressions(depth - 1))
    kind = draw(st.integers(0, 7))
    if kind < 3:
        other = draw(expressions(depth - 1))
        return f"({item} {draw(st.sampled_from(['+', '-', '*']))} {other})"
    # angles are divided by their unit: their products and powers are no angles
    patterns = [
        "sin({})",
        "cos({})",
        "exp(-({})**2)",
        "log(2 + ({})**2)",
        "sqrt(1 + ({})**2)",
        "atan({})/1rad",
        "asin(0.9*sin({}))/1rad",
        "acos(0.9*cos({}))/1rad",
        "tan(0.5*sin({}))",
        "({})**3",
        "1/(1 + ({})**2)",
        "1.5**sin({})",
    ]
    return draw(st.sampled_from(patterns)).format(item)


@pytest.mark.long
@given(expressions())
@settings(deadline=None, max_examples=60)
def test_rates_of_an_expression_are_exact(text):
    state = time_function(f"({text}) + 0*t", "rad")[1]
    value, rate, second = state(TIMES)
    expected, first = complex_step(f"({text}) + 0*t", TIMES)
    # differences of the exact rate check the second derivative
    step = 1e-5
    by_differences = (state(TIMES + step)[1] - state(TIMES - step)[1]) / (2 * step)
    for result, other, exact in (
        (value, expected, 1e-12),
        (rate, first, 1e-12),
        (second, by_differences, 1e-6),
    ):
        np.testing.assert_allclose(result, other, rtol=exact, atol=exact * (1 + np.abs(other).max()))


@given(st.text(alphabet="0123456789.+-*/() tsincodegrmpiahx=[],_'", max_size=24))
@settings(deadline=None, max_examples=200)
def test_any_text_is_a_motion_law_or_is_rejected_in_one_line(text):
    try:
        with np.errstate(all="ignore"):
            value, rate, second = made(text).state(TIMES)
        assert value.shape == rate.shape == second.shape == TIMES.shape
    except InputError as error:
        assert "\n" not in str(error)


def table(folder, text):
    path = folder / "arm.csv"
    path.write_text(text)
    return str(path)


def test_a_table_is_interpolated_smoothly_and_has_a_duration(tmp_path):
    time = np.linspace(0.0, 2.0, 41)
    rows = "".join(f"{t:.17g},{np.sin(3 * t):.17g}\n" for t in time)
    result = made(table(tmp_path, "t,arm\n" + rows))
    assert result.end_time == 2.0
    value, rate, second = result.state(TIMES)
    np.testing.assert_allclose(value, np.sin(3 * TIMES), atol=1e-7)
    np.testing.assert_allclose(rate, 3 * np.cos(3 * TIMES), atol=1e-5)
    np.testing.assert_allclose(second, -9 * np.sin(3 * TIMES), atol=1e-3)
