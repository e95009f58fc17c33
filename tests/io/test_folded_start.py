"""Mobility of a mechanism whose file starts folded, outside the ranges of its joints."""

from dataclasses import replace

from model_files import FOLDER

from mechsim.kinematics.loops.mobility import driver_determinacy
from mechsim.simulation.mjcf_reader.reading import read_model


def test_mobility_at_a_folded_start_is_that_of_the_motion():
    # a ram and two links of equal lengths, which are folded onto each other at length 0
    mechanism = read_model(str(FOLDER / "folded_start_leg.xml")).mechanism
    assert driver_determinacy(mechanism).outcome == "determined"
    # two drivers of one degree of freedom stay redundant
    third = replace(mechanism, driver=("yaw", "length", "knee"))
    assert driver_determinacy(third).redundant_drivers == ("knee",)
