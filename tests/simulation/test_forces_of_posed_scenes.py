"""Accelerations of solved poses are exact to rounding despite large servo and spring forces."""

import numpy as np

import mechsim as ms

# light links with a servo, a spring and a damper whose forces are large for them
OPPOSED = """<mujoco>
  <compiler angle="radian"/>
  <default><geom contype="0" conaffinity="0" density="100"/></default>
  <worldbody>
    <body><joint name="crank" axis="0 0 1"/><geom type="capsule" fromto="0 0 0 .05 0 0" size=".002"/>
      <body pos=".05 0 0"><joint name="rod" axis="0 0 1" damping="1" stiffness="100" springref="2"/>
        <geom type="capsule" fromto="0 0 0 .05 .06 0" size=".002"/>
        <site name="a" pos=".05 .06 0"/></body></body>
    <body pos=".12 0 0"><joint name="rocker" axis="0 0 1"/>
      <geom type="capsule" fromto="0 0 0 -.02 .06 0" size=".002"/><site name="b" pos="-.02 .06 0"/></body>
  </worldbody>
  <equality><connect name="loop" site1="a" site2="b"/></equality>
  <actuator><position joint="crank" kp="1e3"/></actuator>
</mujoco>"""


def test_opposing_servos_do_not_affect_accelerations_of_solved_poses(tmp_path):
    path = tmp_path / "opposed.xml"
    path.write_text(OPPOSED)
    subject = ms.load(path, drive={"crank": "0.3*(1-cos(2*pi*t))"})
    posed = ms.simulate(subject, method="pose").motion
    exact = subject.solve(t=posed.time)
    for name in ("rod", "rocker"):
        expected = exact.joints[name].acceleration
        # measured 1e-15 of the largest, and 3.5e-7 with those forces active
        assert np.abs(posed.joints[name].acceleration - expected).max() < 1e-13 * np.abs(expected).max()
