"""Words to calls, results to text: one file a command.

A file is loaded when its command is typed: `mechsim --help` must be quick.
"""

import signal
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager
from importlib import import_module
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from mechsim._version import __version__
from mechsim.errors import MechsimError

# command -> its file and function, and what it does
COMMANDS = {
    "list": ("catalog.list_mechanisms", "List the mechanisms of the catalogue."),
    "show": (
        "show.show",
        "Show parameters, joints, mobility, crank range, dead centres, assemblies and Assur groups.",
    ),
    "solve": ("solve.solve", "Solve a mechanism in closed form; write .csv or .npz, or print a table."),
    "export": ("export.export", "Write the MuJoCo model of a mechanism."),
    "simulate": ("simulate.simulate", "Run a mechanism in MuJoCo under a driven crank."),
    "validate": (
        "validate.validate",
        "Check closed form, loop equations and MuJoCo against each other; the main job.",
    ),
    "tradeoff": (
        "tradeoff.tradeoff",
        "Measure how fast and how accurate MuJoCo's settings are on one mechanism; recommend some.",
    ),
    "dynamics": (
        "dynamics.dynamics",
        "Drive torque, joint reactions and energy of a prescribed crank; free running under a motor.",
    ),
    "render": (
        "render.render",
        "Draw a mechanism without a screen: .png, .mp4, .webm, .gif, or a new folder of .png files.",
    ),
    "plot": (
        "plot.plot",
        "Plot motions, curves, transmission, errors, velocity plans, dynamics or studies: "
        ".svg, .pdf or .png.",
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
}

# what the command-line library returns for Ctrl-C, without a word
INTERRUPTED = 130
# as a program that the system ends for that: 128 + SIGPIPE
CLOSED_PIPE = 141


class LoadedWhenTyped(TyperGroup):
    """Commands known by name and by what they do; the one that is typed is loaded."""

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return the command that the first word names, and the words for it."""
        name, _, rest = super().resolve_command(ctx, args)
        return name, None if name is None else loaded(name), rest


def loaded(name: str) -> Any:
    """Return a command, its file loaded."""
    file, _, function = COMMANDS[name][0].partition(".")
    alone = typer.Typer(**PLAIN)
    alone.command(name)(getattr(import_module(f"mechsim.cli.{file}"), function))
    return get_command(alone)


app = typer.Typer(
    cls=LoadedWhenTyped, help="Check an analytic model of a linkage against a multibody simulator.", **PLAIN
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
    """Run the command line: 0 all met, 1 something missed, 2 bad input, said in one line."""
    with _listening() as pressed:
        sys.exit(_ended(pressed))


def _ended(pressed: list[int]) -> int:
    """Return the exit code of the command typed."""
    try:
        code = app(standalone_mode=False)
    except MechsimError as error:
        return _refused(str(error))
    except typer.exceptions.TyperException as error:
        message = error.format_message() if hasattr(error, "format_message") else str(error)
        return _refused(message)
    except (KeyboardInterrupt, typer.Abort):
        return _refused("stopped")
    except (BrokenPipeError, SystemExit):
        # the command-line library, too, ends so when nobody reads on
        return CLOSED_PIPE
    except Exception:
        # an interrupted import of compiled code says anything but that
        if not pressed:
            raise
        return _refused("stopped")
    if code == INTERRUPTED:
        return _refused("stopped")
    return code if isinstance(code, int) else 0


@contextmanager
def _listening() -> Generator[list[int]]:
    """Give a list that holds a number for every Ctrl-C pressed; one lost in a destructor prints nothing."""
    pressed: list[int] = []

    def press(number: int, _: object) -> None:
        pressed.append(number)
        raise KeyboardInterrupt

    def lost(what: "sys.UnraisableHookArgs") -> None:
        if not isinstance(what.exc_value, KeyboardInterrupt):
            sys.__unraisablehook__(what)

    here = threading.current_thread() is threading.main_thread()
    before, hook = signal.getsignal(signal.SIGINT), sys.unraisablehook
    if here:
        signal.signal(signal.SIGINT, press)
    sys.unraisablehook = lost
    try:
        yield pressed
    finally:
        sys.unraisablehook = hook
        if here:
            signal.signal(signal.SIGINT, before)


def _refused(message: str) -> int:
    print(f"mechsim: {' '.join(message.split())}", file=sys.stderr)
    return 2
