"""The command line. Everything heavy is imported inside the commands: `mechsim --help` must be quick."""

import sys

import typer

from mechsim.cli.catalogue import export, list_mechanisms, show, solve
from mechsim.cli.drawings import plot
from mechsim.cli.dynamics import dynamics
from mechsim.cli.extremes import extremes
from mechsim.cli.machine import doctor
from mechsim.cli.pictures import render
from mechsim.cli.runs import simulate, validate
from mechsim.cli.synthesis import synthesize
from mechsim.cli.tradeoff import tradeoff
from mechsim.errors import MechsimError

app = typer.Typer(
    help="Check an analytic model of a linkage against a multibody simulator.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
app.command("list")(list_mechanisms)
for command in (
    show,
    solve,
    export,
    simulate,
    validate,
    tradeoff,
    dynamics,
    render,
    plot,
    synthesize,
    doctor,
    extremes,
):
    app.command()(command)


@app.callback(invoke_without_command=True)
def _top(version: bool = typer.Option(False, "--version", help="Print the version.")) -> None:
    """Check an analytic model of a linkage against a multibody simulator."""
    if version:
        from mechsim._version import __version__

        typer.echo(__version__)
        raise typer.Exit


def main() -> None:
    """Run the command line: 0 all met, 1 something missed, 2 bad input, said in one line."""
    try:
        code = app(standalone_mode=False)
    except MechsimError as error:
        sys.exit(_refused(str(error)))
    except typer.exceptions.TyperException as error:
        message = error.format_message() if hasattr(error, "format_message") else str(error)
        sys.exit(_refused(message))
    except (KeyboardInterrupt, typer.Abort):
        sys.exit(_refused("stopped"))
    except BrokenPipeError:
        sys.exit(0)
    sys.exit(code if isinstance(code, int) else 0)


def _refused(message: str) -> int:
    print(f"mechsim: {' '.join(message.split())}", file=sys.stderr)
    return 2
