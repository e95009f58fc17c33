"""Command `mechsim synthesize`: a linkage whose coupler point follows a line."""

import math
from dataclasses import MISSING
from typing import Any

from mechsim import units
from mechsim.cli.command import Result, command
from mechsim.cli.options import Model, ModelOptions, Sets
from mechsim.cli.output import number, print_table
from mechsim.errors import InputError, several
from mechsim.files import attributes
from mechsim.io import catalog
from mechsim.papers.coupler_line import Synthesis, synthesize_looper
from mechsim.units import option

# significant digits of printed dimensions, enough for manufacture
DIMENSION_DIGITS = 6


@command
def synthesize(
    model: Model,
    through: str = option(MISSING, "Middle of the line, as in 12.8751,29.9574mm."),
    tilt: str = option(MISSING, "Angle of the line from +Y towards +X, as in 1.3905deg."),
    length: str = option(MISSING, "Length of the line in y."),
    sets: Sets = None,
) -> Result:
    """Find frame, frame angle and rocker of a looper whose coupler point follows a line in the plane.

    It prints two linkages: the one with the smallest radial error of the rocker's end, the criterion of the
    paper, and the one whose coupler point deviates least from the line. The deviation is the largest distance
    between the path of the coupler point and the line.

    Examples:
    mechsim synthesize looper --through 12.9,30mm --tilt 1.4deg --length 4mm
    mechsim synthesize looper --through 13,30mm --tilt 2deg --length 5mm --json
    """
    base = ModelOptions(model=model, sets=sets).load()
    if not hasattr(base.closed_form, "planar_point"):
        all_formulas = {name: catalog.mechanism(name).formulas for name in catalog.MECHANISMS}
        choices = ", ".join(name for name, made in all_formulas.items() if hasattr(made, "planar_point"))
        raise InputError(f"{base.name} cannot be synthesised; choose from {choices}")
    point = units.parse_vector(through, "m", "--through")
    if len(point) != 2:
        raise InputError(f"--through is {through!r}, {several(len(point), 'number')}; give 2, with a comma")
    line = (point[0], point[1]), units.parse_angle(tilt, "--tilt"), units.parse_length(length, "--length")
    circle_fit = synthesize_looper(*line, base)
    straightest = synthesize_looper(*line, base, equal_ripple=True)
    designs = {"smallest radial error": circle_fit, "straightest": straightest}

    def text() -> None:
        head = ("criterion", "frame [mm]", "angle [deg]", "rocker [mm]", "deviation [mm]")
        print_table(base.name, head, [(name, *_row(design)) for name, design in designs.items()])

    return Result({**_as_dict(circle_fit), "straightest": _as_dict(straightest)}, text)


def _as_dict(design: Synthesis) -> dict[str, Any]:
    return attributes(design, "frame", "frame_angle", "rocker", "deviation")


def _row(design: Synthesis) -> tuple[str, ...]:
    values = design.frame * 1e3, math.degrees(design.frame_angle), design.rocker * 1e3
    return *(number(value, DIMENSION_DIGITS) for value in values), number(design.deviation * 1e3)
