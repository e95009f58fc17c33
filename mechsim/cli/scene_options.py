"""Options of commands that run a user's own MJCF file as it is, and settings as plain MuJoCo has them."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from mechsim import files, units
from mechsim.cli.exit_codes import notes
from mechsim.cli.options import DriveOptions, pairs, require_distinct
from mechsim.errors import InputError
from mechsim.model.links import Vector
from mechsim.model.motion_laws import State, steady
from mechsim.numerics.angles import REVOLUTION
from mechsim.simulation import Settings
from mechsim.studies.scene import UserScene, scene_of
from mechsim.studies.scene.settings import PlainSettings
from mechsim.subjects.law_text import control_laws
from mechsim.subjects.mjcf_source import MjcfForm
from mechsim.subjects.prescription import duration_of
from mechsim.subjects.readers import load
from mechsim.subjects.time_expressions import python_expression

# settings of a driven run -> their names in plain MuJoCo
MUJOCO_NAMES = {"residual": "tolerance"}


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
    if not path.lower().endswith(".xml"):
        raise InputError(f"{path!r} is no MJCF file; name FILE.xml (`mechsim export NAME -o FILE.xml`)")
    require_distinct("--ctrl", controls.ctrl)
    arguments = driven.as_arguments()
    # without motion laws of joints the duration is that of the controls
    solver = load(path, **arguments | {"duration": driven.duration if driven.drive else None})
    assert isinstance(solver, MjcfForm)
    assert solver.source is not None
    notes.extend(f"{solver.name}: {fact}" for fact in solver.facts)
    drive = dict(solver.motion_laws.by_name)
    drive |= {name: steady(value, 0.0) for name, value in solver.mechanism.locked.items()}
    ctrl = control_laws(dict(controls.ctrl))
    laws: dict[str, State] = {**drive, **ctrl}
    points: dict[str, tuple[str, Vector]] | None = dict(solver.mechanism.points) if driven.track else None
    return scene_of(
        solver.source,
        solver.mechanism,
        joint_laws=drive,
        ctrl=ctrl,
        duration=duration_of(driven.duration, None, laws),
        points=points,
        key=driven.key,
    )


def python_laws(scene: UserScene) -> dict[str, str]:
    """Return the laws of joints and controls as Python expressions of t: name -> expression."""
    return {name: _expression(law) for name, law in {**scene.joint_laws, **scene.ctrl}.items()}


def _expression(law: State) -> str:
    text = getattr(law, "text", "")
    if text.lower().endswith(files.EXTENSIONS):
        return f"table({text!r})(t)"
    if re.search(r"\bt\b", text):
        return python_expression(text)
    value, rate, _ = (float(item[0]) for item in law(np.zeros(1)))
    return repr(value) if not rate else f"{value!r} + {rate!r} * t"


def plain_settings(
    settings: Mapping[str, Any], timestep: str | None, file_timestep: float, speed: float | None = None
) -> PlainSettings:
    """Return settings of a run as plain MuJoCo has them; the file determines the others.

    Args:
        settings: by their names in `Settings`.
        timestep: as text, instead of steps per turn.
        file_timestep: time step of the file in [s].
        speed: of the crank in [rad/s], which steps per turn need.

    Raises:
        InputError: for a setting that only a driven run has, or two that exclude each other.
    """
    Settings(**settings)  # raises for values that no run can have
    values = {MUJOCO_NAMES.get(name, name): value for name, value in settings.items()}
    step = None if timestep is None else units.parse_time(timestep, "the time step")
    if step is not None and not 0.0 < step < np.inf:
        raise InputError(f"time step is {timestep}; give a finite time above 0")
    if "steps_per_turn" in values:
        if speed is None:
            raise InputError("--steps-per-turn is of a crank's turn; give --timestep in its place")
        if step is not None:
            raise InputError("both --timestep and --steps-per-turn were given; give one of them")
        step = REVOLUTION / abs(speed) / values["steps_per_turn"]
    if "constant_steps" in values:
        if "solref" in values:
            raise InputError("both --constant-steps and --solref were given; give one of them")
        values["solref"] = values["constant_steps"] * (step or file_timestep), 1.0
    names = {field.name for field in fields(PlainSettings)} & {*values}
    return PlainSettings(timestep=step, **{name: values[name] for name in names})
