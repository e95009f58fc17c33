"""Command `mechsim plot`: writes a plot of a kind in `report.plot_table` to a file."""

from typing import Annotated, Any

from mechsim.cli.command import Result, Stated, command, option_names
from mechsim.cli.load_options import (
    InitialOptions,
    LoadOptions,
    masses_in_json,
    print_masses,
    released_model,
)
from mechsim.cli.options import SPEED, DriveOptions, ModelOptions, Speed
from mechsim.cli.output_paths import plot_file
from mechsim.cli.schema import Written
from mechsim.errors import InputError
from mechsim.pictures import plots
from mechsim.report.plot_table import PLOTS, PlotOptions, PlotSource, require_taken
from mechsim.report.study_plots import drawn_sweep
from mechsim.units import crank_speed, option

# kinds of plots that can also show a motion over time
TIMED = (
    "error",
    "poses",
    "motion",
    "curve",
    "space",
    "schematic",
    "torque",
    "reactions",
    "power",
    "quantities",
)
# kinds of plots in which points have no part
WITHOUT_POINTS = ("phase", "transmission", "plan", "torque", "reactions", "power", "modes")
# kinds of plots of vibrations, which need no run
VIBRATIONS = ("bode", "modes")


class PlotJson(Written):
    """A written plot."""

    kind: str


@command
def plot(
    source: ModelOptions,
    output: Annotated[str, plot_file("Plot to write", "--output")],
    options: PlotOptions,
    initial: InitialOptions,
    stated: Stated,
    kind: str = option("motion", f"Kind of plot: {', '.join(PLOTS)}; of a sweep: map, parallel, pareto."),
    speed: Speed = SPEED,
) -> Result[PlotJson]:
    """Plot motions, curves, errors, dynamics, vibrations or studies: .svg, .pdf or .png.

    The kinds history, phase, bode and modes draw a mechanism whose drivers move freely (`mechsim dynamics`).
    The kinds map, parallel and pareto draw measures, named by --of, from a file of `mechsim sweep`.

    Examples:
    mechsim plot four_bar --kind curve -o curve.svg
    mechsim plot sweep.nc --kind map --of range:rocker -o map.png
    mechsim plot four_bar --kind phase --initial crank.q=30deg -o phase.svg
    """
    if source.model.lower().endswith((".nc", ".zarr", ".parquet", ".csv")):
        require_taken("of a sweep", ("coordinates",), options)
        stated.exclude(("sets", "speed", *option_names(DriveOptions)), "on the file of a sweep")
        figure = drawn_sweep(source.model, options.coordinates, None if kind == "motion" else kind)
        name, masses = source.model, ()
    else:
        if kind not in PLOTS:
            raise InputError(f"there is no plot {kind!r}; choose from {', '.join(PLOTS)}")
        row = PLOTS[kind]
        require_taken(kind, row.takes, options)
        stated.exclude(["track"], f"on plot {kind!r}", kind in WITHOUT_POINTS)
        if row.released == "always" or (row.released == "either" and initial.requested):
            unused = ["until", "duration", "drive", "track"]
            stated.exclude(unused, f"on plot {kind!r}", kind in VIBRATIONS)
            stated.exclude(["speed"], "on drivers that are free; give --initial J.v")
            release = initial.release(released_model(source), source)
            plotted = PlotSource(solver=release.model.solver, speed=0.0, options=options, release=release)
        else:
            plotted = _driven(source, initial, options, speed, kind)
            stated.exclude(["speed"], "under motion laws", not plotted.solver.motion_laws.crank)
        figure, name, masses = row.figure(plotted), plotted.solver.name, plotted.masses
    plots.write(output, figure)
    data: Any = {"mechanism": name, "kind": kind, "output": output, **masses_in_json(masses)}
    return Result(data, lambda: print_masses(masses), files=[output])


def _driven(
    source: ModelOptions,
    initial: InitialOptions,
    options: PlotOptions,
    speed: str,
    kind: str,
) -> PlotSource:
    """Return what is drawn of a driven motion."""
    if initial.requested:
        kinds = ", ".join(name for name, row in PLOTS.items() if row.released != "never")
        raise InputError(
            f"plot {kind!r} shows a driven motion; a run from an initial state is shown by {kinds}"
        )
    solver = source.load_moving()
    if not solver.motion_laws.crank and kind not in TIMED:
        raise InputError(f"plot {kind!r} needs a crank without a motion law; choose from {', '.join(TIMED)}")
    return PlotSource(
        solver=solver, speed=crank_speed(speed), options=options, model=LoadOptions().dynamic_model
    )
