"""Links that a file lets float and its loops hold: they go as the same links hung on joints."""

import numpy as np
import pytest

from mechsim.errors import InputError
from mechsim.simulation import simulate
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.subjects.readers import load

LINKS = """
<mujoco model="four-bar">
  <default><geom type="capsule" size="0.004" mass="0.1"/></default>
  <worldbody>{rod}
    <body name="crank"><joint name="crank" axis="0 1 0"/><geom fromto="0 0 0 0.03 0 0"/>{hung}</body>
    <body name="rocker" pos="0.09 0 0"><joint name="rocker" axis="0 1 0"/>
      <geom fromto="0 0 0 0.02 0 0.06"/></body>
    {beside}
  </worldbody>
  <equality>{held}<connect body1="rocker" body2="rod" anchor="0.02 0 0.06"/></equality>
</mujoco>"""
ROD = '<body name="rod" pos="{x} 0 0">{joint}<geom fromto="0 0 0 0.08 0 0.06" mass="0.3"/></body>'
HUNG = {"rod": "", "hung": ROD.format(x=0.03, joint='<joint axis="0 1 0"/>'), "held": ""}
# two points of its pin hold it as a hinge does
FLOATING = {
    "rod": ROD.format(x=0.03, joint='<freejoint name="float"/>'),
    "hung": "",
    "held": '<connect body1="crank" body2="rod" anchor="0.03 0.01 0"/>'
    '<connect body1="crank" body2="rod" anchor="0.03 -0.02 0"/>',
}


def read(tmp_path, name, parts, beside=""):
    path = tmp_path / f"{name}.xml"
    path.write_text(LINKS.format(**parts, beside=beside))
    return load(str(path), drive={"crank": "0.4*sin(2*pi*t)"})


@pytest.mark.parametrize("method", ["pose", "step"])
def test_the_torque_at_a_crank_is_the_same_whether_its_rod_floats_or_hangs(tmp_path, method):
    torque = [
        driven(
            item.mechanism, item.forces, motion_laws=item.motion_laws, samples=12, method=method
        ).forces.torque
        for item in (read(tmp_path, "hung", HUNG), read(tmp_path, "floating", FLOATING))
    ]
    assert np.ptp(torque[0]) > 0.05
    np.testing.assert_allclose(torque[1], torque[0], atol=1e-6 if method == "step" else 1e-12)


def test_a_mechanism_whose_rod_floats_runs_as_one_whose_rod_hangs(tmp_path):
    forms = [read(tmp_path, "hung", HUNG), read(tmp_path, "floating", FLOATING)]
    runs = [simulate(form.mechanism, motion_laws=form.motion_laws, method="pose").motion for form in forms]
    places = [run.links["rod"].position for run in runs]
    np.testing.assert_allclose(places[1], places[0], atol=1e-14)


def test_a_link_that_nothing_but_a_floating_joint_holds_is_rejected_by_name(tmp_path):
    ball = '<body name="ball" pos="0 0 1"><freejoint name="loose"/><geom/></body>'
    form = read(tmp_path, "loose", HUNG, beside=ball.replace("<geom/>", '<geom type="sphere" size="0.01"/>'))
    with pytest.raises(InputError, match="joint 'loose' floats and nothing else connects its link"):
        driven(form.mechanism, form.forces, motion_laws=form.motion_laws, samples=4)
