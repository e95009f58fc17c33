"""Options of commands that run a user's own MJCF file as it is, and settings as plain MuJoCo has them."""

from dataclasses import dataclass

from mechsim.cli.exit_codes import notes
from mechsim.cli.options import DriveOptions, pairs, require_distinct
from mechsim.studies.scene import UserScene
from mechsim.studies.scene.open_scene import open_scene, require_mjcf


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlOptions:
    """Controls of the actuators of a scene."""

    ctrl: tuple[tuple[str, str], ...] = pairs(
        "--ctrl servo=0.3*sin(2*pi*t)",
        "Control of an actuator of an MJCF file, in the control's own unit: a number, "
        "255*(0.5-0.5*cos(2*pi*t)) (t in s), FILE.csv. The file is then stepped as it is, but for settings "
        "that are given; --drive prescribes joints.",
        "ACTUATOR=LAW",
    )


def user_scene(path: str, driven: DriveOptions, controls: ControlOptions) -> UserScene:
    """Return the scene of an MJCF file and its prescribed motion; notes state what was changed.

    Args:
        path: of the file.
        driven: what drives it, how long, and which points are tracked.
        controls: of its actuators.

    Raises:
        InputError: for what is no MJCF file, or a joint, actuator, keyframe or point that is missing.
        AssemblyError: where its loops do not close at the start of the motion laws.
    """
    require_mjcf(path)
    require_distinct("--ctrl", controls.ctrl)
    scene, changed = open_scene(path, ctrl=dict(controls.ctrl), **driven.as_arguments())
    notes.extend(changed)
    return scene
