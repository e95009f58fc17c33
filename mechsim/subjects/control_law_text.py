"""Control laws of actuators written as text: a constant, an expression of t, or a table."""

from collections.abc import Mapping

import numpy as np

from mechsim import files, units
from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from mechsim.subjects.motion_law_text import MotionLaw, parse_motion_law
from mechsim.subjects.time_expressions import time_function


def control_law(text: str, name: str) -> MotionLaw:
    """Return the control law of an actuator.

    Args:
        text: a number, a quantity such as `20deg` or `30rpm`, which is kept; an expression of t in s, such as
            `255*(0.5-0.5*cos(2*pi*t))`; or FILE.csv with columns t and value. In the control's own unit,
            quantities in SI.
        name: of the actuator.

    Raises:
        InputError: names the actuator, the text and the remedy.
    """
    if text.strip().lower().endswith(files.EXTENSIONS):
        return parse_motion_law(text, name, "rad", lambda: 0.0)
    constant = _constant(text)
    if constant is not None:
        return MotionLaw(text, _constant_law(constant))
    reason = ""
    for unit in ("rad", "m"):
        try:
            return MotionLaw(*time_function(text, unit))
        except InputError as error:
            reason = str(error)
    raise InputError(f"what feeds actuator {name}, {text!r}, {reason}, as in --ctrl '{name}=0.3*sin(2*pi*t)'")


def control_laws(texts: Mapping[str, str]) -> dict[str, MotionLaw]:
    """Return the control laws of several actuators: actuator -> control law."""
    return {name: control_law(text, name) for name, text in texts.items()}


def _constant(text: str) -> float | None:
    """Return a number or a quantity in SI; None for what is neither."""
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return units.of_any_kind(text, "the control")[0]
    except InputError:
        return None


def _constant_law(value: float):
    def state(time: Array) -> tuple[Array, Array, Array]:
        still = np.zeros_like(time)
        return value + still, still, still

    return state
