"""Floating links constrained by loops move as the same links connected by joints."""

import numpy as np
import pytest
from model_files import copied, model_text

from mechsim.io.readers import load
from mechsim.simulation.dynamics.forward_run import stepped_run
from mechsim.simulation.dynamics.prescribed_motion import driven

LINKS = model_text("floating_links_links.xml")
ROD = '<body name="rod" pos="{x} 0 0">{joint}<geom fromto="0 0 0 0.08 0 0.06" mass="0.3"/></body>'
HINGED = {"rod": "", "hinged": ROD.format(x=0.03, joint='<joint axis="0 1 0"/>'), "loops": ""}
# two points of its pin constrain it as a hinge does
FLOATING = {
    "rod": ROD.format(x=0.03, joint='<freejoint name="float"/>'),
    "hinged": "",
    "loops": '<connect body1="crank" body2="rod" anchor="0.03 0.01 0"/>'
    '<connect body1="crank" body2="rod" anchor="0.03 -0.02 0"/>',
}


def read(joints, extra=""):
    return load(copied(LINKS.format(**joints, extra=extra), ".xml"), drive={"crank": "0.4*sin(2*pi*t)"})


@pytest.mark.parametrize("method", ["pose", "step"])
def test_a_floating_rod_gives_the_crank_torque_of_a_hinged_one(method):
    torque = [driven(read(item), samples=12, method=method).forces.torque for item in (HINGED, FLOATING)]
    assert np.ptp(torque[0]) > 0.05
    np.testing.assert_allclose(torque[1], torque[0], atol=1e-6 if method == "step" else 1e-12)


def test_an_unconstrained_floating_link_falls_in_mujoco():
    ball = '<body name="ball" pos="0 0 1"><freejoint name="loose"/><geom type="sphere" size="0.01"/></body>'
    solver = read(HINGED, extra=ball)
    times = np.linspace(0.0, 0.5, 11)
    run = stepped_run(solver.mechanism, solver.forces, {}, {"loose.x": 2.0}, times, 20)
    assert np.allclose(run.motion.joints["loose.x"].value, 2.0 * times, atol=1e-12)
    assert np.allclose(run.motion.joints["loose.z"].value, 1.0 - 0.5 * 9.81 * times**2, atol=1e-12)
