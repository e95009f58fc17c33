"""Command that designs a linkage: synthesize."""

import math
from typing import Annotated, Any

import typer

from mechsim import units
from mechsim.analytic import catalog
from mechsim.analytic.forms import closed_form
from mechsim.cli.options import Json, Model, Sets, form_of
from mechsim.cli.output import print_json
from mechsim.errors import InputError
from mechsim.theory.synthesis import Synthesis, synthesize_looper


def synthesize(
    model: Model,
    through: Annotated[str, typer.Option(help="Middle of the line, as in 12.8751,29.9574mm.")],
    tilt: Annotated[str, typer.Option(help="Angle of the line from +Y towards +X, as in 1.3905deg.")],
    length: Annotated[str, typer.Option(help="Extent of the line in y, its middle at the point.")],
    sets: Sets = None,
    as_json: Json = False,
) -> None:
    """Find frame, frame angle and rocker of a looper so that its coupler point, in the plane, follows a line.

    Two answers: the linkage whose rocker's end keeps its circle best, which is the paper's criterion, and
    the straightest, whose coupler point leaves the line least. The deviation of either is the farthest
    that the path of its coupler point is from the line, over the whole of the line.
    """
    base: Any = closed_form(form_of(model, sets), "a synthesis")
    if "coupler line" not in base.theories:
        raise InputError(f"{base.name} cannot be synthesised; {catalog.with_theory('coupler line')} can")
    point = units.parse_vector(through, "m", "--through")
    if len(point) != 2:
        raise InputError(f"--through is {through!r}, {len(point)} numbers; give 2, with a comma")
    middle, slant = (point[0], point[1]), units.parse_angle(tilt, "--tilt")
    extent = units.parse_length(length, "--length")
    by_circle = synthesize_looper(middle, slant, extent, base)
    straightest = synthesize_looper(middle, slant, extent, base, equal_ripple=True)
    if as_json:
        print_json({**_numbers(by_circle), "straightest": _numbers(straightest)})
    else:
        typer.echo(f"rocker's circle kept best: {_words(by_circle)}")
        typer.echo(f"straightest: {_words(straightest)}")


def _numbers(found: Synthesis) -> dict[str, float]:
    return {name: getattr(found, name) for name in ("frame", "frame_angle", "rocker", "deviation")}


def _words(found: Synthesis) -> str:
    return (
        f"frame {found.frame * 1e3:.6g} mm at {math.degrees(found.frame_angle):.6g} deg, "
        f"rocker {found.rocker * 1e3:.6g} mm; the coupler point stays within "
        f"{found.deviation * 1e3:.4g} mm of the line"
    )
