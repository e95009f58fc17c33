"""Numbers without a unit, probably meant in another: taken as they are, and asked back at the end."""

from collections.abc import Mapping
from dataclasses import fields
from math import pi

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.forms import Form
from mechsim.cli.exit_codes import questions
from mechsim.units import require_written

# angles beyond a turn in radians are rare, in degrees usual; lengths so many times the usual are millimetres
TURN, TOO_LONG = 2.0 * pi, 100.0


def asked_angle(what: str, text: str, form: Form | None = None) -> None:
    """Ask back where an angle without a unit was probably meant in degrees.

    Raises:
        InputError: for one without a unit where the mechanism's file declares another than rad.
    """
    if form is not None:
        require_written(text, "rad", form.written.angle, what)
    value = _bare(text)
    if value is not None and abs(value) > TURN:
        questions.append(f"{what} {text} is {value:g} rad, {value / TURN:.3g} turns; was {text}deg meant?")


def asked_angles(what: str, text: str, form: Form | None = None) -> None:
    """Ask back, or raise InputError, likewise for start:stop:step, of which none has a unit."""
    if form is not None:
        require_written(text, "rad", form.written.angle, what)
    parts = text.split(":")
    values = [value for part in parts if (value := _bare(part)) is not None]
    if len(values) == len(parts) and max(map(abs, values)) > 10.0 * TURN:
        questions.append(f"{what} {text} goes to {max(values):g} rad; was {text}deg meant?")


def asked_parameters(form: Form, given: Mapping[str, str]) -> None:
    """Ask back for parameters of the catalogue that were given without a unit, far from what is usual."""
    if not isinstance(form, ClosedForm):
        return
    known = {field.name: field for field in fields(form)}
    for name, text in given.items():
        value, field = _bare(text), known.get(name)
        if value is None or field is None:
            continue
        unit, usual = field.metadata["unit"], field.default
        if unit == "rad" and abs(value) > TURN:
            questions.append(f"--set {name}={text} is {value:g} rad; was {name}={text}deg meant?")
        if unit == "m" and isinstance(usual, float) and abs(value) > TOO_LONG * abs(usual) > 0.0:
            questions.append(f"--set {name}={text} is {value:g} m; was {name}={text}mm meant?")


def _bare(text: str) -> float | None:
    """Return a number that has no unit; None for anything else."""
    try:
        return float(text)
    except ValueError:
        return None
