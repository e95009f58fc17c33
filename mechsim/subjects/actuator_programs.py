"""What feeds an actuator over time, as people write it: a constant, an expression of t, or a table."""

from collections.abc import Mapping

import numpy as np

from mechsim import files, units
from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.subjects.program_text import Program, program
from mechsim.subjects.time_expressions import over_time


def actuator_program(text: str, name: str) -> Program:
    """Return the program of an actuator's control.

    Args:
        text: a number, a quantity such as `20deg` or `30rpm`, which is kept; an expression of t in s, such as
            `255*(0.5-0.5*cos(2*pi*t))`; or FILE.csv with columns t and value. In the control's own unit,
            quantities in SI.
        name: of the actuator.

    Raises:
        InputError: names the actuator, the text and the remedy.
    """
    if text.strip().lower().endswith(files.EXTENSIONS):
        return program(text, name, "rad", lambda: 0.0)
    constant = _constant(text)
    if constant is not None:
        return Program(text, _kept(constant))
    refused = ""
    for unit in ("rad", "m"):
        try:
            return Program(*over_time(text, unit))
        except InputError as error:
            refused = str(error)
    raise InputError(
        f"what feeds actuator {name}, {text!r}, {refused}, as in --ctrl '{name}=0.3*sin(2*pi*t)'"
    )


def actuator_programs(given: Mapping[str, str]) -> dict[str, Program]:
    """Return the programs of several actuators: actuator -> its program."""
    return {name: actuator_program(text, name) for name, text in given.items()}


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


def _kept(value: float):
    def state(time: Array) -> tuple[Array, Array, Array]:
        still = np.zeros_like(time)
        return value + still, still, still

    return state
