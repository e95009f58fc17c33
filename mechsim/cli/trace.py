"""Command `mechsim trace`: every assembly of a mechanism as closed curves."""

import math
from collections.abc import Mapping
from typing import Annotated

import numpy as np
import typer

from mechsim import files
from mechsim.cli.declared_options import spread
from mechsim.cli.options import DriveOptions, Json, Model, Output, Sets, form_of, writable
from mechsim.cli.output import print_json, print_table
from mechsim.cli.output_units import OutputUnits, Units, output_units
from mechsim.cli.progress import progress
from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from mechsim.pictures import plots
from mechsim.report.assemblies import (
    SAMPLES,
    assembly_table,
    curve_tables,
    joined,
    requested_columns,
    trace_record,
    usual_columns,
)
from mechsim.theory.continuation import AssemblyCurve, AssemblyTrace
from mechsim.theory.continuation import trace as traced
from mechsim.theory.continuation.mechanism_trace import SEED, STARTS
from mechsim.units import parse_names

# what a table may hold of each curve
MOST_SAMPLES = 100_000


@spread
def trace(
    model: Model,
    driven: DriveOptions,
    output: Output = None,
    plot: Annotated[
        str | None, typer.Option(metavar="FILE", help="Plot the curves: .svg, .pdf or .png.")
    ] = None,
    of: Annotated[
        str | None,
        typer.Option(
            metavar="A,B[,C]",
            help="Coordinates to plot over, as columns of the table: angle, rocker, P3.x; two or three.",
        ),
    ] = None,
    samples: Annotated[int, typer.Option(help="Even steps of arc in the table of each curve.")] = SAMPLES,
    starts: Annotated[int, typer.Option(help="Random starts from which curves are looked for.")] = STARTS,
    seed: Annotated[int, typer.Option(help="Of the random starts.")] = SEED,
    sets: Sets = None,
    units: Units = None,
    as_json: Json = False,
) -> None:
    """Trace all assemblies of a mechanism with one freedom as closed curves, past every dead centre.

    A curve holds the poses that are reached without a jump. Told are where coordinates of joints turn back,
    the dead centres of the crank, and where curves meet. What is held stays so; what is driven is let go. A
    curve that runs off along a slide, winds up a screw or is longer than 3,000 cells is refused. The table
    has the columns component, arc, angle of the crank, J.q of joints and P.x, P.y, P.z of points.
    """
    place = None if output is None else writable(output, ".csv", ".npz")
    picture = None if plot is None else writable(plot)
    if plot is not None:
        plots.format_of(plot)
    elif of is not None:
        raise InputError(f"--of {of} says what to plot over; name the file with --plot")
    if not 1 <= samples <= MOST_SAMPLES:
        raise InputError(f"{samples} samples of a curve; give 1 to {MOST_SAMPLES}")
    drive = form_of(model, sets, driven)
    shown = output_units(units, drive)
    over = None if of is None else requested_columns(drive.mechanism, parse_names(of))
    with progress("trace", None, at_least=True) as tick:
        found = traced(drive, starts=starts, seed=seed, progress=tick)
    if place is not None or picture is not None:
        tables = curve_tables(found, samples)
        if picture is not None:
            table = assembly_table(found, tables)
            figure = plots.assembly_plot(table, over or usual_columns(found, table))
            plots.write(picture, figure)
        if place is not None:
            files.write_table(place, _labelled(found, joined(tables), shown))
    if as_json:
        print_json({**trace_record(found), "output": output, "plot": plot})
        return
    _print(found)
    for name in (output, plot):
        if name is not None:
            typer.echo(f"wrote {name}")


def _labelled(
    found: AssemblyTrace, table: Mapping[str, Array], shown: OutputUnits | None
) -> Mapping[str, Array]:
    """Return a table of curves in other units, where they are asked for."""
    if shown is None:
        return table
    units = dict.fromkeys(table, "m") | {"component": "", "arc": "", "angle": "rad"}
    units |= {column.name: column.unit for column in found.curves[0].joints.columns}
    return {
        shown.label(name, units[name]): values / shown.converted(units[name])[0]
        for name, values in table.items()
    }


def _print(found: AssemblyTrace) -> None:
    title = (
        f"{found.mechanism.name}: {_several(len(found.curves), 'component')}; {found.closed} of "
        f"{found.starts} random starts (seed {found.seed}) ended in an assembly"
    )
    first = found.curves[0]
    driver = "crank" if first.driver.unit == "rad" else first.driver.coordinate
    rows = [
        (
            f"{i + 1}{' (its own)' if i == 0 else ''}",
            str(curve.starts_ended),
            f"{curve.length:.6g}",
            *_crank(curve),
        )
        for i, curve in enumerate(found.curves)
    ]
    print_table(title, ("component", "starts", "arc", driver, "dead centres"), rows)
    units = {column.name: column.unit for column in first.joints.columns}
    turning = [
        (
            str(i + 1),
            turn.coordinate,
            "highest" if turn.highest else "lowest",
            _value(turn.value, units[turn.coordinate]),
            f"{turn.arc:.6g}",
            _value(turn.angle, first.driver.unit),
        )
        for i, curve in enumerate(found.curves)
        for turn in curve.turning_points
    ]
    if turning:
        head = ("component", "coordinate", "is", "at", "arc", f"{driver} at")
        print_table("Where coordinates turn back", head, turning)
    for meeting in found.branch_points:
        places = ", ".join(f"{i + 1} at arc {arc:.6g}" for i, arc in meeting.locations)
        angle = _value(meeting.angle, first.driver.unit)
        typer.echo(f"assemblies meet at {driver} {angle}: component {places}")
    for line in found.left_out:
        typer.echo(line)


def _crank(curve: AssemblyCurve) -> tuple[str, str]:
    """Return what the crank does along a curve, and its dead centres."""
    dead = ", ".join(_value(float(at), curve.driver.unit) for at in curve.dead_centres)
    turns = abs(curve.turns)
    return _several(turns, "turn") if turns else "swings" if dead else "stands still", dead


def _several(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def _value(value: float, unit: str) -> str:
    if unit == "m":
        return f"{value * 1e3:.6g} mm"
    degrees = math.degrees(value)
    return f"{0.0 if abs(degrees) < 5e-7 else np.round(degrees, 6):.8g} deg"
