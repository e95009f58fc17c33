"""Mobility of a mechanism whose file starts folded, outside the ranges of its joints."""

from dataclasses import replace

import numpy as np
import pytest

import mechsim as ms
from mechsim.analytic.loops.mobility import driver_determinacy
from mechsim.simulation.mjcf_reader import read_model

# a ram and two links of equal lengths, which are folded onto each other at length 0
LEG = """<mujoco model="leg">
  <compiler angle="radian"/>
  <worldbody>
    <body name="hip"><joint name="yaw" axis="0 0 1" range="-0.5 0.5"/><geom type="sphere" size="0.02"/>
      <body name="foot"><joint name="length" type="slide" axis="0 0 -1" range="0.1 0.5"/>
        <geom type="sphere" size="0.01"/></body>
      <body name="femur"><joint name="femur" axis="0 1 0" range="0.1 1.5"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.01"/>
        <body name="shank" pos="0 0 -0.3"><joint name="knee" axis="0 1 0" range="0.2 2.9"/>
          <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.01"/></body></body>
    </body>
  </worldbody>
  <contact><exclude body1="foot" body2="shank"/></contact>
  <equality><connect name="pin" body1="foot" body2="shank" anchor="0 0 0"/></equality>
  <actuator><position name="yaw" joint="yaw" kp="20"/>
    <position name="ram" joint="length" kp="500"/></actuator>
</mujoco>"""


@pytest.fixture
def leg(tmp_path):
    path = tmp_path / "leg.xml"
    path.write_text(LEG)
    return str(path)


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
