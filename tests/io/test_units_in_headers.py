"""Tables of laws, functions, loads and poses may state units in their headers, as `q [deg]`."""

import tomllib

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim import files
from mechsim.io.parameter_units import parameter_units

ANGLES = np.linspace(0.0, 2.0 * np.pi, 37)
IN_SI = {"q": ANGLES, "value": 0.004 * np.sin(0.5 * ANGLES) ** 2}
IN_DEGREES = {"q [deg]": np.rad2deg(ANGLES), "value [mm]": 1e3 * IN_SI["value"]}


def cam(folder, law):
    files.write_table(folder / "law.csv", law)
    path = folder / "cam.toml"
    roller = 'kind = "roller", radius = "6 mm", offset = "3 mm"'
    guide = 'kind = "prismatic"\na = { link = "ground", at = [0.003, 0, 0], axis = [0, 1, 0] }'
    guide += '\nb = { link = "follower", axis = [0, 1, 0] }'
    path.write_text(
        model_text("toml_cams_model.toml", follower=roller, guide=guide, at=[0, 0, 0], law='"law.csv"')
    )
    return ms.load(path)


def test_the_law_of_a_cam_in_degrees_and_millimetres_is_that_in_si(tmp_path):
    for law in (IN_SI, IN_DEGREES):
        centre = cam(tmp_path, law).solve(ANGLES, speed=1.0).joints["guide"].value
        # the roller starts on the base circle of 25 mm; a table is met at its rows
        lift = centre - np.sqrt(0.031**2 - 0.003**2)
        assert np.abs(lift - IN_SI["value"]).max() < 1e-15


def test_a_motion_law_in_milliseconds_and_degrees_passes_through_its_rows(tmp_path):
    time, angle = np.linspace(0.0, 0.3, 13), np.deg2rad(np.linspace(10.0, 70.0, 13))
    files.write_table(tmp_path / "law.csv", {"t [ms]": 1e3 * time, "value [deg]": np.rad2deg(angle)})
    law = str(tmp_path / "law.csv")
    motion = ms.load("four_bar", drive={"crank": law}).solve(t=time)
    assert np.abs(motion.joints["crank"].value - angle).max() < 1e-14


FILE = model_text("parameter_units_file.toml")


def test_lengths_angles_and_plain_numbers_are_distinguished():
    result = parameter_units(tomllib.loads(FILE))
    lengths = {name for name, unit in result.items() if unit == "m"}
    angles = {name for name, unit in result.items() if unit == "rad"}
    # half is a term of no length: it enters roots and products only
    assert lengths == {"crank", "rod", "reach", "span"}
    assert angles == {"bend", "tilt"}


@pytest.mark.parametrize("document", [{}, {"parameters": 3}, {"parameters": {"a": [1]}, "joints": 4}])
def test_an_invalid_file_determines_no_units(document):
    assert parameter_units(document) == {}


@pytest.mark.parametrize(("motion", "unit"), [("translating", "m"), ("swinging", "rad")])
def test_the_lift_of_a_cam_has_the_unit_of_its_follower(motion, unit):
    cam = {"follower": {"kind": "roller", "motion": motion}, "law": [{"over": 1, "to": "lift"}]}
    result = parameter_units({"parameters": {"lift": 5}, "cams": {"plate": cam}})
    assert result == {"lift": unit}
