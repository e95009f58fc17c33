"""Motion laws as text: their values, exact rates, and invalid texts."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mechsim.errors import InputError
from mechsim.io.law_text import control_law, parse_motion_law

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
        (
            "exp(-t)*log(2+t)*tan(0.5*t)**3/sqrt(1+t)",
            "rad",
            np.exp(-TIMES) * np.log(2 + TIMES) * np.tan(TIMES / 2) ** 3 / np.sqrt(1 + TIMES),
        ),
        (
            "asin(0.9*t) + acos(0.8*t) - atan(t)",
            "rad",
            np.arcsin(0.9 * TIMES) + np.arccos(0.8 * TIMES) - np.arctan(TIMES),
        ),
        ("min(10deg, 20deg*t)", "rad", np.minimum(10, 20 * TIMES) * np.pi / 180),
    ],
)
def test_a_motion_law_gives_position_and_rates_of_its_driver(text, unit, value):
    state = made(text, unit).state
    np.testing.assert_allclose(state(TIMES)[0], value, rtol=1e-14)
    # rates by central differences, away from a corner
    times, step = TIMES + 0.01, 1e-5
    before, after = (np.stack(state(times + sign * step)[:2]) for sign in (-1.0, 1.0))
    rates = np.stack(state(times)[1:])
    np.testing.assert_allclose(rates, (after - before) / (2.0 * step), rtol=1e-7, atol=1e-7)


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


T = np.linspace(0.0, 1.0, 5)


def test_a_control_is_read_from_a_table(tmp_path):
    path = tmp_path / "control.csv"
    path.write_text("t,value\n" + "".join(f"{t},{2 * t}\n" for t in np.linspace(0, 1, 9)))
    result = control_law(str(path), "servo")
    assert result(T)[0] == pytest.approx(2 * T)
    assert result.end_time == 1.0
