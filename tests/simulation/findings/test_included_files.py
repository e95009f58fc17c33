"""Findings in included files are reported with the name of that file and its line."""

from mechsim.simulation.findings import findings
from mechsim.simulation.mjcf_reader import read_model

MAIN = """<mujoco model="m">
  <worldbody>
    <include file="parts/arm.xml"/>
  </worldbody>
  <include file="loops.xml"/>
  <actuator><motor name="turn" joint="crank"/></actuator>
</mujoco>"""
ARM = """<mujocoinclude>
  <body name="crank"><joint name="crank" axis="0 0 1"/><geom size="0.01" pos="0.02 0 0"/>
    <body name="coupler" pos="0.04 0 0"><joint name="A" axis="0 0 1"/><geom size="0.01" pos="0.05 0 0"/>
      <site name="B1" pos="0.1 0 0"/></body></body>
  <include file="rocker.xml"/>
</mujocoinclude>"""
ROCKER = """<mujocoinclude>
  <body name="rocker" pos="0.12 0 0">
    <joint name="C" axis="0 0 1" range="60 80" limited="true"/><geom size="0.01" pos="0 0.04 0"/>
    <site name="B2" pos="0.02 0.08 0"/></body>
</mujocoinclude>"""
LOOPS = """<mujoco>
  <equality>

    <connect site1="B1" site2="B2"/>
  </equality>
</mujoco>"""


def test_a_finding_names_the_included_file_and_the_line_in_it(tmp_path):
    (tmp_path / "parts").mkdir()
    for name, text in (
        ("main.xml", MAIN),
        ("parts/arm.xml", ARM),
        ("rocker.xml", ROCKER),
        ("loops.xml", LOOPS),
    ):
        (tmp_path / name).write_text(text)
    result = {item.kind: item for item in findings(read_model(str(tmp_path / "main.xml")))}
    assert (result["gap"].file, result["gap"].line) == ("loops.xml", 4)
    assert (result["limit"].file, result["limit"].line) == ("rocker.xml", 3)
    assert result["limit"].one_line.startswith("rocker.xml, line 3: joint C starts")


def test_a_finding_in_the_main_file_names_only_the_line(tmp_path):
    arm, rocker = (text.split("\n", 1)[1].rsplit("\n", 1)[0] for text in (ARM, ROCKER))
    body = arm.replace('  <include file="rocker.xml"/>', rocker)
    loops = LOOPS.split("\n", 1)[1].rsplit("\n", 1)[0]
    whole = MAIN.replace('    <include file="parts/arm.xml"/>', body).replace(
        '  <include file="loops.xml"/>', loops
    )
    (tmp_path / "whole.xml").write_text(whole)
    result = {item.kind: item for item in findings(read_model(str(tmp_path / "whole.xml")))}
    for kind, element in (("gap", "<connect"), ("limit", '<joint name="C"')):
        assert result[kind].file == ""
        assert element in whole.splitlines()[result[kind].line - 1]
