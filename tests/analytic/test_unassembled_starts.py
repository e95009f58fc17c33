"""Unassembled starts: the error reports a configuration that assembles, or the loops that lock."""

import re

import numpy as np
import pytest

import mechsim as ms
from mechsim.analytic.loops.mobility import driver_determinacy
from mechsim.analytic.loops.start import assembled
from mechsim.errors import AssemblyError, MobilityError
from mechsim.subjects.mjcf_source import read_mjcf

# collinear joints, as in hand-written files: the residual acts along the line and rotates nothing
IN_A_LINE = """<mujoco>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body><joint name="crank" axis="0 0 1"/><geom type="capsule" fromto="0 0 0 .05 0 0" size=".004"/>
      <body pos=".05 0 0"><joint name="rod" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 {rod} 0 0" size=".004"/>
        <site name="a" pos="{rod} 0 0"/></body></body>
    <body pos=".09 0 0"><joint name="rocker" axis="0 0 1"/>
      <geom type="capsule" fromto="0 0 0 -.08 0 0" size=".004"/><site name="b" pos="-.08 0 0"/></body>
  </worldbody>
  <equality><connect name="loop" site1="a" site2="b"/></equality>
  <actuator><motor joint="crank"/></actuator>{more}
</mujoco>"""


def _line(folder, rod, more=""):
    path = folder / "line.xml"
    path.write_text(IN_A_LINE.format(rod=rod, more=more))
    return path


def test_an_unassembled_start_reports_joint_values_that_assemble(tmp_path):
    with pytest.raises(AssemblyError, match="do not close at the start of the other joints") as reported:
        assembled(read_mjcf(str(_line(tmp_path, 0.07))).mechanism)
    output = dict(re.findall(r"(crank|rod|rocker) = (-?[\d.]+)", str(reported.value)))
    key = f'<keyframe><key name="on" qpos="{output["crank"]} {output["rod"]} {output["rocker"]}"/></keyframe>'
    loops, q = assembled(read_mjcf(str(_line(tmp_path, 0.07, key)), key="on").mechanism)
    assert np.abs(loops.linearise(q)[0]).max() < 1e-12
    # the triangle with the crank on the line, by the law of cosines
    angle = np.arccos((0.04**2 + 0.07**2 - 0.08**2) / (2 * 0.04 * 0.07))
    assert abs(q.values[loops.tree.index_of["rod"], 0]) == pytest.approx(angle, abs=1e-12)


def test_mobility_analysis_reports_an_unassembled_start(tmp_path):
    with pytest.raises(AssemblyError, match="do not close at the start of the other joints"):
        driver_determinacy(read_mjcf(str(_line(tmp_path, 0.07))).mechanism)


def test_loops_that_cannot_close_are_rejected_with_a_remedy(tmp_path):
    with pytest.raises(AssemblyError, match=r"a gap of .* remains.* change the dimensions"):
        assembled(read_mjcf(str(_line(tmp_path, 0.15))).mechanism)


def test_an_out_of_plane_pin_is_reported_with_its_offset(tmp_path):
    path = _line(tmp_path, 0.07)
    offset = path.read_text().replace('pos="-.08 0 0"', 'pos="0 .07 .002"')
    path.write_text(offset)
    with pytest.raises(
        AssemblyError, match=r"loop has a gap of .* m that no joint in its loop can close"
    ) as reported:
        assembled(read_mjcf(str(path)).mechanism)
    direction = [
        float(number) for number in re.findall(r"gap of \((.*)\) m", str(reported.value))[0].split(",")
    ]
    np.testing.assert_allclose(np.abs(direction), [0.0, 0.0, 0.002], atol=1e-9)
    path.write_text(offset.replace(".002", "0"))
    loops, q = assembled(read_mjcf(str(path)).mechanism)
    assert np.abs(loops.linearise(q)[0]).max() < 1e-12


# two rods between double arms: immobile with arms of unequal length; with
# a difference of 0.2 % the loop-closure error is at most 1e-7 of the characteristic length
TWO_RODS = """<mujoco>
  <worldbody>
    <body><joint name="crank" axis="0 0 1"/><geom type="capsule" fromto="-.01 -.02 0 .01 .02 0" size=".003"/>
      <body pos=".01 .02 0"><joint name="one" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 .1 0 0" size=".003"/>
        <site name="a" pos=".100017996 .000041002 0"/></body>
      <body pos="-.01 -.02 0"><joint name="two" axis="0 0 1"/>
        <geom type="capsule" fromto="0 0 0 .1 0 0" size=".003"/>
        <site name="b" pos=".099982004 -.000041002 0"/></body></body>
    <body pos=".1 0 0"><joint name="arm" axis="0 0 1"/>
      <geom type="capsule" fromto="-.01 -.02 0 .01 .02 0" size=".003"/>
      <site name="c" pos=".010017996 .020041002 0"/><site name="d" pos="-.010017996 -.020041002 0"/></body>
  </worldbody>
  <equality><connect name="upper" site1="a" site2="c"/>
    <connect name="lower" site1="b" site2="d" active="{active}"/></equality>
  <actuator><motor joint="crank"/></actuator>
</mujoco>"""


def test_loops_that_lock_a_driver_are_reported_by_name(tmp_path):
    path = tmp_path / "rods.xml"
    laws = {"crank": "0.3*sin(2*pi*t)"}
    path.write_text(TWO_RODS.format(active="true"))
    with pytest.raises(MobilityError, match=r"crank cannot move, for upper and lower .* lock"):
        ms.load(path, drive=laws).solve(t=np.linspace(0.0, 1.0, 21))
    path.write_text(TWO_RODS.format(active="false"))
    motion = ms.load(path, drive=laws, lock={"two": None}).solve(t=np.linspace(0.0, 1.0, 21))
    assert np.isfinite(motion.joints["arm"].value).all()
