"""Command `mechsim plot`: one of the kinds of `report.plot_table` into a file."""

from collections.abc import Sequence
from typing import Annotated

import typer

from mechsim.cli.declared_options import spread
from mechsim.cli.load_options import print_masses
from mechsim.cli.options import (
    SPEED,
    DriveOptions,
    File,
    Json,
    Model,
    Sets,
    Speed,
    form_of,
    moving,
    speed_of,
    writable,
)
from mechsim.cli.output import print_json
from mechsim.cli.progress import progress
from mechsim.errors import InputError
from mechsim.model.masses import LinkMass
from mechsim.pictures import plots
from mechsim.report.plot_table import PLOTS, PlotOptions, PlotSource, require_taken
from mechsim.studies.sweep.table import drawn_sweep

# the kinds that show a motion over time as well
TIMED = ("error", "poses", "motion", "curve", "space", "schematic", "torque", "reactions", "power")


@spread
def plot(
    model: Model,
    output: File,
    asked: PlotOptions,
    kind: Annotated[
        str, typer.Option(help=f"One of {', '.join(PLOTS)}; of a sweep map, parallel or pareto.")
    ] = "motion",
    speed: Speed = SPEED,
    *,
    driven: DriveOptions,
    sets: Sets = None,
    as_json: Json = False,
) -> None:
    """Plot motions, curves, transmission, errors, velocity plans, dynamics or studies: .svg, .pdf or .png.

    Of what `mechsim sweep` wrote: kind map, parallel or pareto, of the measures that --of names.

    Kind precision takes 20 s to measure, kind stability minutes; `mechsim tradeoff` and `mechsim extremes`
    tell the numbers too.
    """
    plots.format_of(output)
    place = writable(output)
    if model.lower().endswith((".nc", ".zarr", ".parquet", ".csv")):
        require_taken("of a sweep", ("coordinates",), asked)
        if sets or speed != SPEED or driven != DriveOptions():
            raise InputError(
                f"{model} is what a sweep wrote; leave out what sets, drives or holds a mechanism"
            )
        plots.write(place, drawn_sweep(model, asked.coordinates, None if kind == "motion" else kind))
        _tell(model, kind, output, as_json)
        return
    if kind not in PLOTS:
        raise InputError(f"there is no plot {kind!r}; known are {', '.join(PLOTS)}")
    require_taken(kind, PLOTS[kind].takes, asked)
    drive = moving(form_of(model, sets, driven))
    if drive.motion_laws is not None and speed != SPEED:
        raise InputError(f"--speed is of a crank without a program, and {drive.name} has one; leave it out")
    if drive.motion_laws is not None and kind not in TIMED:
        raise InputError(
            f"plot {kind!r} is of a crank without a program; under programs known are {', '.join(TIMED)}"
        )
    with progress("plot", None) as tick:
        source = PlotSource(solver=drive, speed=speed_of(speed), options=asked, progress=tick)
        figure = PLOTS[kind].figure(source)
    plots.write(place, figure)
    _tell(drive.name, kind, output, as_json, source.masses)


def _tell(name: str, kind: str, output: str, as_json: bool, masses: Sequence[LinkMass] = ()) -> None:
    if as_json:
        used = {"masses": [one.as_dict() for one in masses]} if masses else {}
        print_json({"mechanism": name, "kind": kind, "output": output} | used)
    else:
        typer.echo(f"wrote {output}")
        print_masses(masses)
