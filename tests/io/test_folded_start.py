"""Mobility of a mechanism whose file starts folded, outside the ranges of its joints."""

from dataclasses import replace

import numpy as np
import pytest
from model_files import model_text

import mechsim as ms
from mechsim.kinematics.loops.mobility import driver_determinacy
from mechsim.simulation.mjcf_reader.reading import read_model

# a ram and two links of equal lengths, which are folded onto each other at length 0
LEG = model_text("folded_start_leg.xml")


@pytest.fixture
def leg(file):
    return file(LEG)


def test_a_ram_of_a_folded_leg_drives_it(leg):
    lengths = np.array([0.15, 0.3, 0.45])
    solver = ms.load(leg, drive={"length": "0.15+0.3*t", "yaw": "0rad"})
    knee = solver.solve(t=[0.0, 0.5, 1.0]).joints["knee"].value
    # isosceles triangle of the links, whose base is the ram
    np.testing.assert_allclose(knee, 2.0 * np.arcsin(lengths / 0.6), atol=1e-12)
    assert any("start outside their ranges" in fact for fact in solver.facts)
    assert {"MS108", "MS111"}.isdisjoint(violation.rule for violation in ms.check(leg))


def test_mobility_at_a_folded_start_is_that_of_the_motion(leg):
    mechanism = read_model(leg).mechanism
    assert driver_determinacy(mechanism).outcome == "determined"
    # two drivers of one degree of freedom stay redundant
    third = replace(mechanism, driver=("yaw", "length", "knee"))
    assert driver_determinacy(third).redundant_drivers == ("knee",)


ARM = """<mujoco><worldbody><body name="arm"><joint name="elbow" range="{low} -4" axis="0 1 0"/>
<geom type="capsule" size=".01" fromto="0 0 0 .2 0 0"/></body></worldbody></mujoco>"""


def test_an_open_chain_starts_within_its_ranges_too(tmp_path):
    (path := tmp_path / "arm.xml").write_text(ARM.format(low=-176))
    solver = ms.load(str(path), still=True)
    assert any("start outside their ranges" in fact for fact in solver.facts)
    run = ms.dynamics.run(solver, duration=0.05)
    # it weighs on the stop at which it starts
    assert run.outcome == "stopped"
    assert run.motion.joints["elbow"].value[0] == pytest.approx(np.deg2rad(-4.0), abs=1e-12)
