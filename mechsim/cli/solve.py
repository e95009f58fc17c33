"""Command `mechsim solve`: a motion in closed form."""

import sys
from collections.abc import Iterator
from typing import Annotated

import numpy as np
import typer

from mechsim import files, units
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.forms import Form
from mechsim.cli.options import (
    Json,
    Model,
    Output,
    Sets,
    Speed,
    ThroughChange,
    form_of,
    passed,
    speed_of,
    writable,
)
from mechsim.cli.output import Tick, print_json, progress
from mechsim.maths.arrays import Array
from mechsim.maths.memory import require_room
from mechsim.model.motion import Motion

# crank angles solved in one go where the results leave part by part
PART = 1 << 17
# bytes held for each number that is written as .npz, and as JSON
PACKED, AS_JSON = 40.0, 160.0


def solve(
    model: Model,
    angles: Annotated[
        str, typer.Option(help="Crank angles start:stop:step, both ends included; a bare number is rad.")
    ] = "0:360:5deg",
    speed: Speed = "600rpm",
    through: ThroughChange = "smooth",
    sets: Sets = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Solve a mechanism in closed form; write .csv or .npz, or print a table."""
    place = None if output is None else writable(output, ".csv", ".npz")
    drive = passed(form_of(model, sets), through)
    asked, at = units.parse_angles(angles, "the crank angles"), speed_of(speed)
    if as_json or (place is not None and place.suffix.lower() == ".npz"):
        numbers = len(asked) * (1.0 + 9.0 * len(drive.mechanism.points))
        what = f"{len(asked):,} crank angles"
        require_room(what, numbers, AS_JSON if as_json else PACKED, "write .csv, which needs no memory")
        motion = _solved(drive, asked, at)
        if place is not None:
            files.write(place, motion)
        if as_json:
            columns = dict(motion.columns())
            print_json({"mechanism": drive.name, "rows": len(motion), "output": output, "columns": columns})
    else:
        # loop equations are followed from the first angle to the last, a closed form is not
        each = PART if isinstance(drive, ClosedForm) else len(asked)
        with progress("solve", -(-len(asked) // each)) as tick:
            parts = _parts(drive, asked, at, each, tick)
            if place is not None:
                files.write_in_parts(place, parts)
            else:
                _print(parts)
    if place is not None and not as_json:
        typer.echo(f"wrote {len(asked)} rows to {output}")


def _parts(drive: Form, angles: Array, speed: float, each: int, tick: Tick) -> Iterator[Motion]:
    """Yield the motion part by part."""
    for first in range(0, len(angles), each):
        yield _solved(drive, angles[first : first + each], speed)
        tick()


def _solved(drive: Form, angles: Array, speed: float) -> Motion:
    if isinstance(drive, ClosedForm):
        return drive.solve(angles, speed, links=False)
    return drive.solve(angles, speed)


def _print(parts: Iterator[Motion]) -> None:
    for number, part in enumerate(parts):
        columns = dict(part.columns())
        if number == 0:
            print(",".join(columns))
        rows = np.column_stack(list(columns.values()))
        sys.stdout.writelines(",".join(map(repr, row.tolist())) + "\n" for row in rows)
