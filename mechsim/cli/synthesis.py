"""Command that designs a linkage: synthesize."""

import math
from typing import Annotated

import typer

from mechsim.cli.options import Json, Name, Sets, drive_of
from mechsim.cli.output import print_json


def synthesize(
    name: Name,
    through: Annotated[str, typer.Option(help="A point of the line, as in 12.8751,29.9574mm.")],
    tilt: Annotated[str, typer.Option(help="Angle of the line from +Y towards +X, as in 1.3905deg.")],
    length: Annotated[str, typer.Option(help="Length of the line, its middle at the point.")],
    sets: Sets = None,
    as_json: Json = False,
) -> None:
    """Find frame, frame angle and rocker so that the coupler point follows a line as well as can be."""
    from mechsim import units
    from mechsim.catalog.looper import Looper
    from mechsim.errors import InputError
    from mechsim.synthesis import synthesize_looper

    base = drive_of(name, sets)
    if not isinstance(base, Looper):
        raise InputError(f"{name} cannot be synthesised; looper can")
    point = units.parse_vector(through, "m", "--through")
    if len(point) != 2:
        raise InputError(f"--through is {through!r}, {len(point)} numbers; give 2, with a comma")
    found = synthesize_looper(
        (point[0], point[1]), units.parse_angle(tilt, "--tilt"), units.parse_length(length, "--length"), base
    )
    answer = {
        "frame": found.frame,
        "frame_angle": found.frame_angle,
        "rocker": found.rocker,
        "deviation": found.deviation,
    }
    if as_json:
        print_json(answer)
    else:
        typer.echo(
            f"frame {found.frame * 1e3:.6g} mm at {math.degrees(found.frame_angle):.6g} deg, "
            f"rocker {found.rocker * 1e3:.6g} mm: the coupler point stays within "
            f"{found.deviation * 1e3:.3g} mm of the line"
        )
