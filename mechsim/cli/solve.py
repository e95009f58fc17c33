"""Command `mechsim solve`: a motion in closed form."""

from typing import Annotated

import typer

from mechsim import files, units
from mechsim.cli.options import Json, Model, Output, Sets, Speed, form_of, speed_of, writable
from mechsim.cli.output import print_json


def solve(
    model: Model,
    angles: Annotated[
        str, typer.Option(help="Crank angles start:stop:step, both ends included; a bare number is rad.")
    ] = "0:360:5deg",
    speed: Speed = "600rpm",
    sets: Sets = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Solve a mechanism in closed form; write .csv or .npz, or print a table."""
    place = None if output is None else writable(output, ".csv", ".npz")
    drive = form_of(model, sets)
    motion = drive.solve(units.parse_angles(angles, "the crank angles"), speed_of(speed))
    if place is not None:
        files.write(place, motion)
    columns = dict(motion.columns())
    if as_json:
        print_json({"mechanism": drive.name, "rows": len(motion), "output": output, "columns": columns})
    elif place is None:
        print(",".join(columns))
        for row in zip(*columns.values(), strict=True):
            print(",".join(repr(float(value)) for value in row))
    else:
        typer.echo(f"wrote {len(motion)} rows to {output}")
