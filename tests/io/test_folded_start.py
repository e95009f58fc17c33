"""Mobility of a mechanism whose file starts folded, outside the ranges of its joints."""

from dataclasses import replace

import pytest
from model_files import model_text

from mechsim.kinematics.loops.mobility import driver_determinacy
from mechsim.simulation.mjcf_reader.reading import read_model

# a ram and two links of equal lengths, which are folded onto each other at length 0
LEG = model_text("folded_start_leg.xml")


@pytest.fixture
def leg(file):
    return file(LEG)


def test_mobility_at_a_folded_start_is_that_of_the_motion(leg):
    mechanism = read_model(leg).mechanism
    assert driver_determinacy(mechanism).outcome == "determined"
    # two drivers of one degree of freedom stay redundant
    third = replace(mechanism, driver=("yaw", "length", "knee"))
    assert driver_determinacy(third).redundant_drivers == ("knee",)
