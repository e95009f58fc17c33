import numpy as np
import pytest

from mechsim.io.law_text import control_law

T = np.linspace(0.0, 1.0, 5)


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2", 2.0 + 0 * T),
        ("-0.5", -0.5 + 0 * T),
        ("20deg", np.deg2rad(20.0) + 0 * T),
        ("30rpm", np.pi + 0 * T),
        ("255*(0.5-0.5*cos(2*pi*t))", 127.5 * (1.0 - np.cos(2 * np.pi * T))),
        ("30deg*sin(t)", np.pi / 6 * np.sin(T)),
        ("4mm*t", 0.004 * T),
    ],
)
def test_a_control_is_a_constant_or_an_expression(text, value):
    assert control_law(text, "servo")(T)[0] == pytest.approx(value)


def test_a_control_is_read_from_a_table(tmp_path):
    path = tmp_path / "control.csv"
    path.write_text("t,value\n" + "".join(f"{t},{2 * t}\n" for t in np.linspace(0, 1, 9)))
    result = control_law(str(path), "servo")
    assert result(T)[0] == pytest.approx(2 * T)
    assert result.end_time == 1.0
