"""Words to calls, results to text: one file a command.

A file is loaded when its command is typed: `mechsim --help` must be quick.
"""

import os
import sys
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from mechsim._version import __version__
from mechsim.cli.exit_codes import ended, tell

# command -> its file and function, and what it does in a line of a list
COMMANDS = {
    "list": ("show.list_mechanisms", "List the mechanisms of catalogue and gallery."),
    "show": ("show.show", "Show joints, mobility, range, dead centres, assemblies."),
    "solve": ("solve.solve", "Solve a mechanism: closed form or loop equations."),
    "simulate": ("simulate.simulate", "Run a mechanism in MuJoCo."),
    "validate": ("validate.validate", "Check formulas, loop equations and MuJoCo: the main job."),
    "export": ("export.export", "Write a mechanism as a MuJoCo model or as TOML."),
    "schema": ("schema.schema", "Print JSON Schemas of TOML files and --json outputs."),
    "dynamics": ("dynamics.dynamics", "Tell drive torques, joint reactions, energies."),
    "trace": ("trace.trace", "Trace all assemblies as closed curves."),
    "synthesize": ("synthesize.synthesize", "Find a looper whose coupler point follows a line."),
    "sweep": ("sweep.sweep", "Measure many designs of a mechanism."),
    "sensitivity": ("sensitivity.sensitivity", "Derive quantities by dimensions; spread tolerances."),
    "fit": ("fit.fit", "Find dimensions from measured motion."),
    "tradeoff": ("tradeoff.tradeoff", "Measure speed and accuracy of MuJoCo's settings."),
    "tune": ("tune.tune", "Find the cheapest settings that keep a tolerance."),
    "reduce": ("reduce.reduce", "Leave out of a scene what is not needed."),
    "extremes": ("extremes.extremes", "Push a mechanism until something breaks; say where."),
    "plot": ("plot.plot", "Plot motions, curves, errors, dynamics, studies."),
    "render": ("render.render", "Draw a mechanism, or film it, without a screen."),
    "view": ("view.view", "Make a page to turn a mechanism by hand."),
    "doctor": ("doctor.doctor", "Say what this machine has and lacks."),
}
# those that load MuJoCo as they run, not before: their help is told without it
LATE = ("doctor", "extremes", "view")
PLAIN: dict[str, Any] = {
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
    alone = typer.Typer(add_completion=False, **PLAIN)
    runs_mujoco = name in LATE or "mujoco" in sys.modules
    alone.command(name)(_without_mujocos_log(command) if runs_mujoco else command)
    return get_command(alone)


def _without_mujocos_log(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command that MuJoCo says nothing beside, on stderr or in a file of its own."""

    @wraps(command)
    def run(**given: Any) -> None:
        from mechsim.simulation.mjcf import quiet
        from mechsim.simulation.mujoco_loading import PROBLEM

        if PROBLEM:
            tell(f"mechsim: {PROBLEM}")
        quiet()(command)(**given)

    return run


app = typer.Typer(
    cls=LoadedWhenTyped,
    help="Check an analytic model of a linkage against a multibody simulator.",
    **PLAIN,
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
