"""The use of parameters in a file determines their units; plain numbers of --set are in SI."""

import tomllib

import pytest
from model_files import model_text

from mechsim.io.parameter_units import parameter_units

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
