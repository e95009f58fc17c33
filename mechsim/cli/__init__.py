"""Words to calls, results to text: one file a command.

A file is loaded when its command is typed: `mechsim --help` must be quick.
"""

import os
import sys
from collections.abc import Callable
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from mechsim._version import __version__
from mechsim.cli.endings import ended, tell

# command -> its file and function, and what it does
COMMANDS = {
    "list": ("catalog.list_mechanisms", "List the mechanisms of the catalogue and of the gallery."),
    "show": (
        "show.show",
        "Show parameters, joints, mobility, crank range, dead centres, assemblies and Assur groups.",
    ),
    "solve": ("solve.solve", "Solve a mechanism in closed form; write .csv or .npz, or print a table."),
    "export": ("export.export", "Write the MuJoCo model of a mechanism, or the mechanism as TOML."),
    "schema": (
        "schema.schema",
        "Print the JSON Schema of mechanisms in TOML, or of what a command prints with --json.",
    ),
    "simulate": (
        "simulate.simulate",
        "Run a mechanism in MuJoCo under a driven crank, or under programs of its drivers.",
    ),
    "validate": (
        "validate.validate",
        "Check closed form, loop equations, formulas and MuJoCo against each other; the main job.",
    ),
    "tradeoff": (
        "tradeoff.tradeoff",
        "Measure how fast and how accurate MuJoCo's settings are on one mechanism; recommend some.",
    ),
    "reduce": (
        "reduce.reduce",
        "Leave out of a scene what is not needed for what is tracked; write what is left.",
    ),
    "tune": (
        "tune.tune",
        "Find the cheapest settings with which plain MuJoCo keeps a tolerance on your own scene and motion.",
    ),
    "dynamics": (
        "dynamics.dynamics",
        "What drives and joints carry as prescribed, and the energies; free running under a motor.",
    ),
    "render": (
        "render.render",
        "Draw a mechanism without a screen: .png, .mp4, .webm, .gif, or a new folder of .png files.",
    ),
    "view": (
        "view.view",
        "Make a page to turn a mechanism by hand, offline; without -o the browser opens it.",
    ),
    "plot": (
        "plot.plot",
        "Plot motions, curves, transmission, errors, velocity plans, dynamics or studies: "
        ".svg, .pdf or .png.",
    ),
    "fit": (
        "fit.fit",
        "Find dimensions from measured motion, with their uncertainty; say which cannot be told apart.",
    ),
    "sensitivity": (
        "sensitivity.sensitivity",
        "Derive quantities by dimensions, exactly; say what tolerances make of them, and who is to blame.",
    ),
    "trace": (
        "trace.trace",
        "Trace all assemblies of a mechanism with one freedom as closed curves, past every dead centre.",
    ),
    "sweep": (
        "sweep.sweep",
        "Measure many designs of a mechanism; write .nc, .zarr, .parquet or .csv, part by part.",
    ),
    "synthesize": (
        "synthesize.synthesize",
        "Find frame, frame angle and rocker so that the coupler point, in the plane, follows a line.",
    ),
    "doctor": (
        "doctor.doctor",
        "Say what this machine has: OpenGL back ends, ffmpeg, versions, and what mends what is missing.",
    ),
    "extremes": (
        "extremes.extremes",
        "Push steps, speed, size, masses, poses, turns and gears until something breaks; say where it does.",
    ),
}
PLAIN: dict[str, Any] = {
    "add_completion": False,
    "rich_markup_mode": None,
    "pretty_exceptions_enable": False,
    "context_settings": {"help_option_names": ["-h", "--help"]},
}


class LoadedWhenTyped(TyperGroup):
    """Commands known by name and by what they do; the one that is typed is loaded."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return the command that the first word names, and the words for it."""
        name, _, rest = super().resolve_command(ctx, args)
        return name, None if name is None else loaded(name), rest


def loaded(name: str) -> Any:
    """Return a command, its file loaded."""
    file, _, function = COMMANDS[name][0].partition(".")
    command = getattr(import_module(f"mechsim.cli.{file}"), function)
    alone = typer.Typer(**PLAIN)
    alone.command(name)(_without_mujocos_log(command) if "mujoco" in sys.modules else command)
    return get_command(alone)


def _without_mujocos_log(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that MuJoCo says nothing beside, on stderr or in a file of its own."""
    from mechsim.simulation.mjcf import quiet
    from mechsim.simulation.mujoco_loading import PROBLEM

    if PROBLEM:
        tell(f"mechsim: {PROBLEM}")
    return quiet()(command)


app = typer.Typer(
    cls=LoadedWhenTyped,
    help="Check an analytic model of a linkage against a multibody simulator.",
    **PLAIN | {"add_completion": True},
)
for known, (_, about) in COMMANDS.items():
    app.command(known, help=about)(lambda: None)


@app.callback(invoke_without_command=True)
def _top(
    context: typer.Context, version: bool = typer.Option(False, "--version", help="Print the version.")
) -> None:
    """Check an analytic model of a linkage against a multibody simulator."""
    if version:
        typer.echo(__version__)
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def main() -> None:
    """Run the command line; see `endings.ended` for its exit codes."""
    # all matrices are small: threads of the linear algebra only stand in the way of mechsim's own
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(ended(lambda: app(standalone_mode=False)))
