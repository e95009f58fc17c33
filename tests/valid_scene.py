"""A scene without findings, and variants with changed text."""

# a four-bar with a ball joint, so that its loop has no redundant equation
SOUND = """<mujoco model="four-bar">
  <option timestep="0.001" gravity="0 0 -9.81"/>
  <compiler angle="radian" autolimits="true"/>
  <worldbody>
    <body name="crank">
      <joint name="crank" axis="0 0 1" range="-3 3"/>
      <inertial pos="0.02 0 0" mass="0.05" diaginertia="2e-6 2e-5 2e-5"/>
      <geom name="crank" type="capsule" fromto="0.008 0 0 0.03 0 0" size="0.003"/>
      <body name="coupler" pos="0.04 0 0" euler="0 0 0.7">
        <joint name="A" type="ball"/>
        <inertial pos="0.05 0 0" mass="0.08" diaginertia="5e-6 8e-5 8e-5"/>
        <geom name="coupler" type="capsule" fromto="0.008 0 0 0.09 0 0" size="0.003"/>
        <site name="B1" pos="0.1 0 0"/>
      </body>
    </body>
    <body name="rocker" pos="0.1 0 0.01" euler="0 0 1.3">
      <joint name="rocker" axis="0 0.1 1" range="-2 2"/>
      <inertial pos="0.03 0 0" mass="0.06" diaginertia="3e-6 3e-5 3e-5"/>
      <geom name="rocker" type="capsule" fromto="0.01 0 0 0.055 0 0" size="0.003"/>
      <site name="B2" pos="0.0675 0 0"/>
    </body>
  </worldbody>
  <equality>
    <connect name="loop" body1="coupler" body2="rocker" anchor="0.1 0 0" solref="0.002 1"
             solimp="0.9999 0.9999 0.001 0.5 2"/>
  </equality>
  <actuator>
    <position name="servo" joint="crank" kp="10" kv="0.1"/>
  </actuator>
</mujoco>
"""


def changed(*changes):
    """Return the text of the scene with replaced pieces, each of which occurs once."""
    text = SOUND
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text
