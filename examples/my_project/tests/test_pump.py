"""The pump's formula against its mechanism: two tests pass, one fails on purpose."""

import numpy as np

import mechsim as ms


def test_the_control_software_knows_where_the_piston_is(mechsim):
    report = mechsim.assert_agrees("../models/pump.toml", "../models/pump.py:piston", tolerance=1e-6)
    assert report.passed


def test_the_stroke_agrees_with_the_data_sheet(mechsim):
    x = mechsim.load("../models/pump.toml").positions(np.linspace(0, 2 * np.pi, 721))["piston"][:, 0]
    assert abs(np.ptp(x) - 0.0602) < 1e-4


def test_red_on_purpose_a_rod_one_millimetre_too_long():
    def rod_of_96_mm(angle):
        inner = 0.096**2 - (0.008 - 0.03 * np.sin(angle)) ** 2
        x = 0.03 * np.cos(angle) + np.sqrt(inner)
        return {"piston": np.column_stack([x, np.full_like(x, 0.008), np.zeros_like(x)])}

    ms.testing.assert_agrees("models/pump.toml", rod_of_96_mm, tolerance=1e-6)
