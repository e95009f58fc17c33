"""A small MJCF scene: the finger of a gripper under a servo, with a soft loop constraint."""

from model_files import model_text

from mechsim.io.law_text import control_laws
from mechsim.io.readers import load
from mechsim.studies.scene.scene import scene_of

FINGER = model_text("finger.xml")
CONTROL, DRIVEN = {"servo": "0.5*sin(2*pi*t)"}, {"knuckle": "0.5*sin(2*pi*t)"}


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
