"""Warnings on numbers without a unit that probably were meant in another one; the run uses them as typed."""

from collections.abc import Mapping
from dataclasses import fields
from math import pi

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.solvers import KinematicSolver
from mechsim.cli.exit_codes import questions
from mechsim.units import require_written

# [rad] an angle without a unit above this is probably in degrees
REVOLUTION = 2.0 * pi
# the same for the end of a range of angles, which may span several revolutions
LARGEST_RANGE = 10.0 * REVOLUTION
# a length without a unit so many times the default is probably in millimetres
LENGTH_RATIO = 100.0


def warn_about_angle(name: str, text: str, solver: KinematicSolver | None = None) -> None:
    """Warn where an angle without a unit was probably meant in degrees.

    Raises:
        InputError: for an angle without a unit where the mechanism's file declares another unit than rad.
    """
    if solver is not None:
        require_written(text, "rad", solver.written.angle, name)
    value = _without_unit(text)
    if value is not None and abs(value) > REVOLUTION:
        questions.append(
            f"{name} {text} is {value:g} rad, {value / REVOLUTION:.3g} turns; was {text}deg meant?"
        )


def warn_about_angles(name: str, text: str, solver: KinematicSolver | None = None) -> None:
    """Warn, or raise InputError, likewise for start:stop:step without units."""
    if solver is not None:
        require_written(text, "rad", solver.written.angle, name)
    values = [_without_unit(item) for item in text.split(":")]
    numbers = [value for value in values if value is not None]
    if len(numbers) == len(values) and max(map(abs, numbers)) > LARGEST_RANGE:
        questions.append(f"{name} {text} goes to {max(numbers):g} rad; was {text}deg meant?")


def warn_about_parameters(solver: KinematicSolver, texts: Mapping[str, str]) -> None:
    """Warn about parameters of the catalogue without a unit that differ much from their defaults."""
    if not isinstance(solver, ClosedForm):
        return
    by_name = {field.name: field for field in fields(solver)}
    for name, text in texts.items():
        value, field = _without_unit(text), by_name.get(name)
        if value is None or field is None:
            continue
        unit, default = field.metadata["unit"], field.default
        if unit == "rad" and abs(value) > REVOLUTION:
            questions.append(f"--set {name}={text} is {value:g} rad; was {name}={text}deg meant?")
        if unit == "m" and isinstance(default, float) and abs(value) > LENGTH_RATIO * abs(default) > 0.0:
            questions.append(f"--set {name}={text} is {value:g} m; was {name}={text}mm meant?")


def _without_unit(text: str) -> float | None:
    """Return a number without a unit; None for anything else."""
    try:
        return float(text)
    except ValueError:
        return None
