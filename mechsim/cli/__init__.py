"""Words to calls, results to text: one file a command.

Everything heavy is imported inside the commands: `mechsim --help` must be quick.
"""

import signal
import sys
import threading
from collections.abc import Generator
from contextlib import contextmanager

import typer

from mechsim.cli import (
    catalog,
    doctor,
    dynamics,
    extremes,
    plot,
    render,
    simulate,
    synthesize,
    tradeoff,
    validate,
)
from mechsim.errors import MechsimError

# what the command-line library returns for Ctrl-C, without a word
INTERRUPTED = 130
# as a program that the system ends for that: 128 + SIGPIPE
CLOSED_PIPE = 141

app = typer.Typer(
    help="Check an analytic model of a linkage against a multibody simulator.",
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
app.command("list")(catalog.list_mechanisms)
for command in (
    catalog.show,
    catalog.solve,
    catalog.export,
    simulate.simulate,
    validate.validate,
    tradeoff.tradeoff,
    dynamics.dynamics,
    render.render,
    plot.plot,
    synthesize.synthesize,
    doctor.doctor,
    extremes.extremes,
):
    app.command()(command)


@app.callback(invoke_without_command=True)
def _top(
    context: typer.Context, version: bool = typer.Option(False, "--version", help="Print the version.")
) -> None:
    """Check an analytic model of a linkage against a multibody simulator."""
    if version:
        from mechsim._version import __version__

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
        # the command-line library, too, leaves this way when nobody reads on
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
