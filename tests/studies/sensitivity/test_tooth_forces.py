"""Derivatives of tooth forces and of the resulting bearing forces."""

import numpy as np
import pytest
from model_files import FOLDER

import mechsim as ms

FILE = str(FOLDER / "tooth_forces_file.toml")
ANGLES = np.deg2rad([10.0, 40.0, 200.0])
COLUMNS = ["mesh crank-second.fx", "mesh crank-second.fy", "second.fx", "second.fy", "rack.fy", "crank.fx"]


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "value", "unit"), [("pressure", 20.0, "deg"), ("across", 30.0, "mm"), ("radius", 12.0, "mm")]
)
def test_derivatives_of_tooth_forces_equal_finite_differences(name, value, unit):
    result = ms.sensitivity(FILE, COLUMNS, [name], angles=ANGLES, speed=30.0)
    step = 1e-3

    def columns(changed):
        solver = ms.load(FILE, set={name: f"{changed} {unit}"})
        return dict(ms.dynamics.prescribed(ms.dynamics.dynamic_model(solver), ANGLES, 30.0).columns())

    plus, minus = columns(value + step), columns(value - step)
    in_si = np.deg2rad(step) if unit == "deg" else 1e-3 * step
    for column in COLUMNS:
        expected = (plus[column] - minus[column]) / (2.0 * in_si)
        np.testing.assert_allclose(result.by[name][column], expected, rtol=1e-6, atol=1e-5)


def test_the_separating_force_of_a_rack_follows_the_pressure_angle():
    result = ms.sensitivity(ms.load(FILE), ["rack.fy"], ["pressure"], angles=ANGLES, speed=30.0)
    expected = 20.0 / np.cos(np.deg2rad(20.0)) ** 2
    np.testing.assert_allclose(np.abs(result.by["pressure"]["rack.fy"]), expected, rtol=1e-12)
