"""The range of a user's joint holds on every road: a start beyond it is refused in the same words."""

import numpy as np
import pytest

from mechsim import simulate
from mechsim.analytic import dynamics
from mechsim.errors import AssemblyError
from mechsim.subjects.driver_rows import poses_at
from mechsim.subjects.subject import load

ARM = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <worldbody>
    <body name="a"><joint name="crank" axis="0.1 0.2 1"/><geom size="0.01" pos="0.1 0 0" mass="0.1"/>
      <body name="b" pos="0.2 0 0.05"><joint name="wrist" axis="0.1 1 0.2" limited="true" range="0.2 1"/>
        <geom size="0.01" pos="0.1 0 0" mass="0.1"/><site name="tip" pos="0.15 0.02 0.01"/></body></body>
  </worldbody>
</mujoco>"""


@pytest.fixture
def arm(tmp_path):
    def made(held, text=ARM):
        path = tmp_path / "arm.xml"
        path.write_text(text)
        return load(str(path), drive={"crank": "0.3*sin(t)"}, hold={"wrist": held})

    return made


def prescribed(form):
    machine = dynamics.machine(form, form.forces)
    return dynamics.prescribed(machine, t=np.linspace(0.0, 1.0, 5))


ROADS = {
    "solved": lambda form: form.solve(t=np.linspace(0.0, 1.0, 5)),
    "row by row": lambda form: poses_at(form, {"crank": np.array([0.0, 0.1])}, "rows.csv"),
    "posed": lambda form: simulate(form, method="pose"),
    "stepped": lambda form: simulate(form, method="step"),
    "inverse dynamics": prescribed,
}


@pytest.mark.parametrize("road", ROADS)
def test_a_start_beyond_a_range_is_refused_on_every_road_and_one_within_is_not(arm, road):
    with pytest.raises(AssemblyError, match=r"joint 'wrist' would stand at 0\.1 rad, .* of 0\.2 to 1, at "):
        ROADS[road](arm("0.1rad"))
    ROADS[road](arm("0.3rad"))
    off = ARM.replace("<worldbody>", '<option><flag limit="disable"/></option><worldbody>')
    ROADS[road](arm("0.1rad", off))


def test_poses_say_what_floats_beside_them(tmp_path):
    path = tmp_path / "load.xml"
    load_text = '<body name="load" pos="1 0 0"><freejoint/><geom size="0.01"/></body></worldbody>'
    path.write_text(ARM.replace("</worldbody>", load_text))
    run = simulate(str(path), drive="crank", speed=1.0, turns=0.1, holds={"wrist": 0.3}, method="pose")
    assert "load floats beside what is driven, and poses say nothing of that: it stands" in run.note
    assert "--hold-base" in run.note
    path.write_text(ARM)
    run = simulate(str(path), drive="crank", speed=1.0, turns=0.1, holds={"wrist": 0.3}, method="pose")
    assert run.note == ""
