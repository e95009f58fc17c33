"""Controls of the actuators of a user's MJCF scene, as options."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from mechsim.cli.exit_codes import notes
from mechsim.cli.options import DriveOptions, pairs

if TYPE_CHECKING:
    from mechsim.studies.scene.scene import UserScene


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlOptions:
    """Controls of the actuators of a scene."""

    ctrl: tuple[tuple[str, str], ...] = pairs(
        "--ctrl servo=0.3*sin(2*pi*t)",
        "Control of an actuator of an MJCF file, in its own unit: a number, an expression of t in s "
        "(255*(0.5-0.5*cos(2*pi*t))), or FILE.csv. The file is stepped with its own settings, except those "
        "given here.",
        "ACTUATOR=LAW",
    )


def user_scene(path: str, driven: DriveOptions, controls: ControlOptions) -> "UserScene":
    """Return the scene of an MJCF file and its prescribed motion; notes state what was changed.

    Args:
        path: path of the file.
        driven: drivers, duration and tracked points.
        controls: controls of the actuators.

    Raises:
        InputError: if the file is not MJCF, or a joint, actuator, keyframe or point is missing.
        AssemblyError: if the loops do not close at the start of the motion laws.
    """
    from mechsim.studies.scene.open_scene import open_scene, require_mjcf

    require_mjcf(path)
    scene, changed = open_scene(path, ctrl=dict(controls.ctrl), **driven.as_arguments())
    notes.extend(changed)
    return scene
