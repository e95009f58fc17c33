"""Command `mechsim plot`: writes a plot of a kind in `report.plot_table` to a file."""

from dataclasses import replace
from typing import Annotated, Any

from mechsim.cli.command import Result, Stated, Without, command, output_file
from mechsim.cli.load_options import LoadOptions, ReleaseOptions, masses_in_json, print_masses, released_model
from mechsim.cli.options import SPEED, ModelOptions, Speed
from mechsim.errors import InputError
from mechsim.mechanism.quantities import quantity_names
from mechsim.pictures import plots
from mechsim.report.plot_table import OF_RUNS, PLOTS, PlotSource, plot_kind
from mechsim.studies.drawn_motion import moved_by_forces
from mechsim.units import crank_speed, option


@command
def plot(
    source: Annotated[ModelOptions, Without("loops")],
    output: Annotated[str, output_file("Plot to write: .svg, .pdf or .png.", ".svg", ".pdf", ".png")],
    stated: Stated,
    coordinates: tuple[str, ...] | None = option(
        None, "Quantities to draw: P.x, rocker.v, distance:P,Q.", read=quantity_names, name="--of"
    ),
    kind: str = option("motion", f"Kind of plot: {', '.join(PLOTS)}."),
    speed: Speed = SPEED,
) -> Result:
    """Plot motions, curves, errors or quantities: .svg, .pdf or .png.

    Forces, runs and vibrations are drawn by `-o` of `mechsim dynamics`.

    Examples:
    mechsim plot four_bar --kind curve -o curve.svg
    mechsim plot four_bar --kind quantities --of rocker.v -o rocker.svg
    """
    if source.model.lower().endswith((".nc", ".csv")):
        raise InputError(
            f"{source.model} is a table, and plot draws mechanisms; draw it with xarray or pandas"
        )
    row = plot_kind(kind, coordinates)
    stated.exclude(["track"], f"on plot {kind!r}", row.transmission)
    solver, release = replace(source, duration=None).load(still=True), None
    if kind in OF_RUNS and moved_by_forces(solver):
        stated.exclude(["speed"], "in a run from the start, under the forces of the file")
        release = ReleaseOptions().release(released_model(source), source)
    elif kind != "schematic":
        solver = source.load_moving()
    if not solver.motion_laws.crank and row.transmission:
        kinds = ", ".join(name for name, other in PLOTS.items() if not other.transmission)
        raise InputError(f"plot {kind!r} needs a crank without a motion law; choose from {kinds}")
    plotted = PlotSource(
        solver=solver,
        speed=crank_speed(speed),
        quantities=coordinates or (),
        model=LoadOptions().dynamic_model,
        release=release,
    )
    stated.exclude(["speed"], "under motion laws", not solver.motion_laws.crank)
    figure, name, masses = row.figure(plotted), plotted.solver.name, plotted.masses
    plots.write(output, figure)
    data: dict[str, Any] = {"mechanism": name, "kind": kind, "output": output, **masses_in_json(masses)}
    return Result(data, lambda: print_masses(masses), files=[output])
