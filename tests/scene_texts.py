"""A small MJCF scene: the finger of a gripper under a servo, with a soft loop constraint."""

from mechsim.studies.scene.scene import scene_of
from mechsim.subjects.law_text import control_laws
from mechsim.subjects.readers import load

FINGER = """<mujoco model="finger">
  <!-- a four-bar under a position servo, and a pad that swings on it against a spring -->
  <option timestep="0.002"/>
  <default>
    <joint axis="0 0 1" damping="0.002"/>
    <equality solref="0.005 1" solimp="0.95 0.99 0.001"/>
  </default>
  <worldbody>
    <body name="crank">
      <inertial mass="0.02" pos="0.015 0 0" diaginertia="1e-6 3e-6 3e-6"/>
      <joint name="knuckle" armature="1e-4"/>
      <body name="rod" pos="0.03 0 0">
        <inertial mass="0.03" pos="0.04 0.01 0" diaginertia="2e-6 9e-6 9e-6"/>
        <joint name="elbow"/>
      </body>
    </body>
    <body name="lever" pos="0.07 0.005 0">
      <inertial mass="0.03" pos="0 0.025 0" diaginertia="9e-6 2e-6 9e-6"/>
      <joint name="pivot"/>
      <body name="pad" pos="0 0.06 0">
        <inertial mass="0.01" pos="0.01 0 0" diaginertia="1e-6 1e-6 1e-6"/>
        <joint name="swing" stiffness="0.05" damping="0.001"/>
      </body>
    </body>
  </worldbody>
  <equality>
    <connect name="closing" body1="rod" body2="lever" anchor="0.04 0.055 0"/>
  </equality>
  <actuator>
    <position name="servo" joint="knuckle" kp="0.5" kv="0.02"/>
  </actuator>
</mujoco>
"""


def scene(folder, *, ctrl=None, drive=None, text=FINGER, duration=0.5):
    """Return the scene of a text and its motion."""
    path = folder / "finger.xml"
    path.write_text(text)
    solver = load(str(path), drive=drive)
    motion_laws = solver.motion_laws.by_name
    control = control_laws(ctrl or {})
    return scene_of(solver.source, solver.mechanism, joint_laws=motion_laws, ctrl=control, duration=duration)


# the finger on a floating base
FLOATING = FINGER.replace(
    "<worldbody>",
    '<worldbody><body name="hull" pos="0 0 1"><freejoint name="float"/><inertial mass="1" pos="0 0 0" '
    'diaginertia="1e-3 1e-3 1e-3"/>',
).replace(
    "</worldbody>",
    '</body></worldbody><keyframe><key name="home" qpos="0 .2 1.5 1 0 0 0 0 0 0 0" ctrl="0.1"/></keyframe>',
)
