"""Options of commands that run a user's own MJCF file as it is: what moves it, how long, what counts."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from mechsim import files, units
from mechsim.cli.exit_codes import notes
from mechsim.cli.options import LockOptions, driving, once, pairs
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
from mechsim.units import option

NOTHING_HELD = LockOptions()
CTRL = "--ctrl servo=0.3*sin(2*pi*t)"


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneOptions:
    """What a user's scene is put through, and which points count."""

    drive: tuple[tuple[str, str], ...] = driving("Prescribe a joint")
    ctrl: tuple[tuple[str, str], ...] = pairs(
        CTRL,
        "Feed an actuator, in its control's own unit: a number, 255*(0.5-0.5*cos(2*pi*t)) (of t in s), "
        "FILE.csv.",
        "ACTUATOR=PROGRAM",
    )
    key: str | None = option(None, "Start from this keyframe.", metavar="NAME")
    track: tuple[str, ...] = option(
        (),
        "Follow this point; all body origins, and where loops are closed, if left out.",
        read=str,
        many=True,
        metavar="NAME[,BODY@X,Y,Z]",
    )
    duration: float | None = option(
        None, "Of the motion; as long as a table lasts, else 1 s, if left out.", unit="s"
    )


def user_scene(path: str, asked: SceneOptions, held: LockOptions = NOTHING_HELD) -> UserScene:
    """Return the scene of an MJCF file and the motion it is put through; what was changed is told on stderr.

    Args:
        path: of the file.
        asked: what moves it, how long, and which points count.
        held: joints that are prescribed to stand still, and whether what floats does.

    Raises:
        InputError: for what is no MJCF file, or a joint, actuator, keyframe or point that is not there.
        AssemblyError: where its loops do not close where programs begin.
    """
    if not path.lower().endswith(".xml"):
        raise InputError(f"{path!r} is no MJCF file; name FILE.xml (`mechsim export NAME -o FILE.xml`)")
    for what, given in (("--drive", asked.drive), ("--ctrl", asked.ctrl), ("--lock", held.lock)):
        once(what, given)
    form = load(
        path,
        drive=dict(asked.drive),
        lock=dict(held.lock),
        fix_base=held.fix_base,
        key=asked.key,
        track=asked.track,
        # without laws of joints the duration is that of the controls
        duration=asked.duration if asked.drive else None,
    )
    assert isinstance(form, MjcfForm)
    assert form.source is not None
    for fact in form.facts:
        notes.append(f"{form.name}: {fact}")
    drive = {} if form.motion_laws is None else dict(form.motion_laws.by_name)
    drive |= {name: steady(value, 0.0) for name, value in form.mechanism.locked.items()}
    ctrl = control_laws(dict(asked.ctrl))
    states: dict[str, State] = {**drive, **ctrl}
    points: dict[str, tuple[str, Vector]] | None = dict(form.mechanism.points) if asked.track else None
    return scene_of(
        form.source,
        form.mechanism,
        joint_laws=drive,
        ctrl=ctrl,
        duration=duration_of(asked.duration, None, states),
        points=points,
        key=asked.key,
    )


def expressions(scene: UserScene) -> dict[str, str]:
    """Return what prescribes joints and feeds actuators as Python expressions of t: name -> expression."""
    return {name: _expression(state) for name, state in {**scene.joint_laws, **scene.ctrl}.items()}


def _expression(state: State) -> str:
    text = getattr(state, "text", "")
    if text.lower().endswith(files.EXTENSIONS):
        return f"table({text!r})(t)"
    if re.search(r"\bt\b", text):
        return python_expression(text)
    value, rate, _ = (float(part[0]) for part in state(np.zeros(1)))
    return repr(value) if not rate else f"{value!r} + {rate!r} * t"


# settings of a driven run -> what plain MuJoCo calls them
CALLED = {"residual": "tolerance"}


def plain_settings(
    asked: Mapping[str, Any], timestep: str | None, own: float, speed: float | None = None
) -> PlainSettings:
    """Return what plain MuJoCo is told of the settings of a run; what is not asked for the file says.

    Args:
        asked: settings by their names in `Settings`.
        timestep: as written, in place of steps in a turn.
        own: time step of the file in [s].
        speed: of the crank in [rad/s], which steps in a turn need.

    Raises:
        InputError: for a setting that only a driven run has, or two that say the same.
    """
    Settings(**asked)  # refuses what no run can have
    told = {CALLED.get(name, name): value for name, value in asked.items()}
    step = None if timestep is None else units.parse_time(timestep, "the time step")
    if step is not None and not 0.0 < step < np.inf:
        raise InputError(f"time step is {timestep}; give a finite time above 0")
    if "steps_per_turn" in told:
        if speed is None:
            raise InputError("--steps-per-turn is of a crank's turn; give --timestep in its place")
        if step is not None:
            raise InputError("both --timestep and --steps-per-turn were given; give one of them")
        step = REVOLUTION / abs(speed) / told["steps_per_turn"]
    if "constant_steps" in told:
        if "solref" in told:
            raise InputError("both --constant-steps and --solref were given; give one of them")
        told["solref"] = told["constant_steps"] * (step or own), 1.0
    known = {one.name for one in fields(PlainSettings)} & {*told}
    return PlainSettings(timestep=step, **{name: told[name] for name in known})
