"""The options of a run's settings as plain MuJoCo has them, for what steps or writes a file."""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from mechsim import units
from mechsim.errors import InputError
from mechsim.numerics.angles import TURN
from mechsim.simulation import Settings
from mechsim.studies.scenes.plain_settings import PlainSettings

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
        step = TURN / abs(speed) / told["steps_per_turn"]
    if "constant_steps" in told:
        if "solref" in told:
            raise InputError("both --constant-steps and --solref were given; give one of them")
        told["solref"] = told["constant_steps"] * (step or own), 1.0
    known = {one.name for one in fields(PlainSettings)} & {*told}
    return PlainSettings(timestep=step, **{name: told[name] for name in known})
