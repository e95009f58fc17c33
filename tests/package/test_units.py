import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mechsim as ms


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("13 mm", "m", 0.013),
        ("13mm", "m", 0.013),
        (" 1um ", "m", 1e-6),
        ("1 µm", "m", 1e-6),
        ("2 inch", "m", 0.0508),
        ("-0.5", "m", -0.5),
        ("1e-3", "m", 0.001),
        (".5 cm", "m", 0.005),
        ("180 deg", "rad", np.pi),
        ("180°", "rad", np.pi),
        ("0.25 turn", "rad", np.pi / 2),
        ("1.5", "rad", 1.5),
        ("1.5 rad", "rad", 1.5),
        ("60rpm", "rad/s", 2 * np.pi),
        ("60 rev/min", "rad/s", 2 * np.pi),
        ("90 deg/s", "rad/s", np.pi / 2),
        ("7", "rad/s", 7.0),
        ("2 ms", "s", 0.002),
        ("3", "1", 3.0),
        ("5 %", "1", 0.05),
        ("3 m^2/m", "m", 3.0),
        ("3 m**2 / m", "m", 3.0),
        ("2 m/s * s", "m", 2.0),
        ("2 1/m * m", "1", 2.0),
        ("2 deg per s", "rad/s", np.pi / 90),
        ("5 Nm", "N m", 5.0),
        ("5 mNm", "N m", 0.005),
    ],
)
def test_quantities_are_converted_to_si(text, unit, value):
    assert ms.units.parse(text, unit) == pytest.approx(value, rel=4e-16, abs=0.0)


def test_helpers_agree_with_the_parser():
    assert ms.units.rpm(3000) == pytest.approx(ms.units.parse_speed("3000 rpm"), rel=4e-16)
    assert ms.units.rpm(60) == pytest.approx(2 * np.pi, rel=4e-16)
    assert ms.units.deg(20) == pytest.approx(ms.units.parse_angle("20 deg"), rel=4e-16)
    assert ms.units.parse_time("1 min") == 60.0


def test_the_last_unit_of_a_vector_applies_to_missing_ones():
    assert ms.units.parse_vector("43,-10,-24mm", "m") == (0.043, -0.01, -0.024)
    assert ms.units.parse_vector("43 mm, 1 cm, 2m", "m") == (0.043, 0.01, 2.0)
    assert ms.units.parse_vector("0.5", "m") == (0.5,)


@given(st.integers(-720, 720), st.integers(1, 400), st.integers(1, 50), st.booleans())
def test_a_range_of_angles_has_both_ends_and_equal_steps(start, count, step, falling):
    step = -step if falling else step
    angles = ms.units.parse_angles(f"{start}:{start + count * step}:{step}deg")
    assert len(angles) == count + 1
    exact = np.deg2rad(np.array([start + i * step for i in range(count + 1)]))
    assert np.abs(angles - exact).max() <= 1e-14
    assert angles[-1] == ms.units.parse_angle(f"{start + count * step}deg")


def test_ranges_and_lists_of_angles_are_read():
    assert len(ms.units.parse_angles("0:360:5deg")) == 73
    assert ms.units.parse_angles("0:360:5deg")[-1] == 2 * np.pi
    assert len(ms.units.parse_angles("0:1:0.1deg")) == 11
    assert ms.units.parse_angles("0:1:0.3").tolist() == pytest.approx([0.0, 0.3, 0.6, 0.9, 1.0])
    assert ms.units.parse_angles("30:30:5deg").tolist() == pytest.approx([np.pi / 6])
    assert ms.units.parse_angles("0,90,180deg").tolist() == pytest.approx([0.0, np.pi / 2, np.pi])
    assert ms.units.parse_angles("0 deg:1 turn:90 deg").tolist() == pytest.approx(
        (np.pi / 2 * np.arange(5)).tolist()
    )
