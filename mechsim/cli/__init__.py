"""Command line: one module for each command, imported when the command is used."""

import inspect
import os
import shlex
import sys
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from types import SimpleNamespace
from typing import Any, ClassVar

import typer
from typer.core import TyperCommand, TyperGroup
from typer.main import get_command

from mechsim._version import __version__
from mechsim.cli.exit_codes import exit_code, print_stderr
from mechsim.errors import InputError

EXAMPLES = "\nExamples:\n"
# examples below the list of commands
FIRST_STEPS = {
    "": ("mechsim validate four_bar", "mechsim show gripper.xml", "mechsim validate --help"),
    "dynamics ": ("mechsim dynamics inverse slider_crank --speed 600rpm", "mechsim dynamics forward --help"),
}
# panel -> long names of its options; a command's own options come first, without a panel
PANELS = {
    "Model": "set lock fix-base key start loops track gravity load motor scene",
    "Initial state": "initial until budget",
    "Motion": "drive ctrl speed turns angles angle at samples duration change-point",
    "Solver": "method tolerance timestep setting compliance drive-inertia budget seed",
    "Output": "output units json verbose plot report csv help",
}
PANEL_OF = {name: panel for panel, names in PANELS.items() for name in names.split()}
# name of an option's type, if its declaration has none
TYPES = {
    "speed": "SPEED",
    "angle": "ANGLE",
    "angles": "ANGLE:ANGLE:ANGLE",
    "tilt": "ANGLE",
    "tolerance": "LENGTH",
    "length": "LENGTH",
    "timestep": "TIME",
    "duration": "TIME",
    "budget": "TIME",
    "offset": "ANGLE",
    "through": "X,Y",
    "gravity": "X,Y,Z",
    "size": "WIDTHxHEIGHT",
    "scene": "LEVEL",
    "kind": "KIND",
    "by": "ERROR",
    "of": "X,Y[,Z]",
}
BY_CLASS = {"int": "N", "float": "NUMBER", "str": "NAME"}


def _converted(value: Any, param: Any, ctx: Any) -> Any:
    """Return the value that a command gets for what the command line states.

    Only values that are no texts need the conversions of the library: they load pydantic, which takes 0.1 s.
    """
    if value is None:
        return () if param.multiple or param.nargs == -1 else None
    kind = param.type_descriptor.annotation
    if kind in (str, list[str]):
        return value if kind is str else list(value)
    if kind is int and isinstance(value, str) and value.isdecimal():
        return int(value)
    if type(value) is kind:
        return value
    return type(param).get_runtime_param(param).coerce(value, param=param, ctx=ctx)


def _converted_late(parameters: list[Any]) -> list[Any]:
    """Let parameters load the conversions of the library when they need them."""
    for parameter in parameters:
        parameter.get_runtime_param = lambda: SimpleNamespace(coerce=_converted)
    return parameters


class PlainCommand(TyperCommand):
    """A command with a help page of option panels and examples."""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters."""
        return _converted_late(super().get_params(ctx))

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the words of a command; reject a second value of an option that takes one."""
        order: list[Any] = [*self.make_parser(ctx).parse_args(args=[*args])[2]]
        for parameter in (each for each in order if each.param_type_name == "option"):
            if order.count(parameter) > 1 and not (parameter.multiple or parameter.is_flag):
                raise InputError(f"{max(parameter.opts, key=len)} takes one value; give it once")
        return super().parse_args(ctx, args)

    def format_help_text(self, ctx: Any, formatter: Any) -> None:
        """Write the description of the command without its examples."""
        formatter.write_paragraph()
        with formatter.indentation():
            formatter.write_text(inspect.cleandoc(self.help or "").partition(EXAMPLES)[0])

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write arguments, options and examples."""
        panels: dict[str, list[Any]] = {"Arguments": [], "Options": [], **{panel: [] for panel in PANELS}}
        parameters: list[Any] = self.get_params(ctx)
        for parameter in parameters:
            if parameter.param_type_name == "argument":
                panels["Arguments"].append((parameter.metavar, parameter.help or ""))
                continue
            name = max(parameter.opts, key=len).lstrip("-")
            if parameter.metavar is None and not getattr(parameter, "is_flag", False):
                kind = parameter.display_type(ctx).strip("<>")
                parameter.metavar = TYPES.get(name, BY_CLASS.get(kind, kind))
            record = parameter.get_help_record(ctx)
            if record is not None:
                panels[PANEL_OF.get(name, "Options")].append(record)
        for panel, records in panels.items():
            if records:
                with formatter.section(panel):
                    formatter.write_dl(records, col_max=26)
        with formatter.section("Examples"):
            for line in examples(self.help):
                formatter.write(f"  {line}\n")


def examples(doc: str | None) -> list[str]:
    """Return the example lines of a docstring."""
    return [line.strip() for line in inspect.cleandoc(doc or "").partition(EXAMPLES)[2].splitlines()]


# group -> command -> its module and function, and its line in the list of commands
GROUPS = {
    "Models": {
        "list": ("show.list_mechanisms", "List the mechanisms that come with mechsim."),
        "show": ("show.show", "Show joints, mobility, range, dead centres, assemblies."),
        "check": ("check.check_files", "Check MJCF and URDF files for common mistakes (linter)."),
        "export": ("export.export", "Write a mechanism as MJCF, TOML or URDF."),
    },
    "Motion": {
        "solve": ("solve.solve", "Solve a mechanism: closed form or loop equations."),
        "simulate": ("simulate.simulate", "Run a mechanism in MuJoCo."),
        "sample": ("sample.sample", "Draw closed configurations of a MuJoCo model."),
        "map": ("map.map_joints", "Map motors to joints: positions, Jacobians, torques."),
        "trace": ("trace.trace", "Trace all assemblies as closed curves."),
    },
    "Dynamics": {
        "dynamics inverse": ("inverse_dynamics.inverse", "Compute torques and reactions of a motion."),
        "dynamics forward": ("forward_dynamics.forward", "Run from an initial state, with motors."),
        "dynamics statics": ("statics.statics", "List equilibria and holding torques."),
        "dynamics modes": ("statics.modes", "Compute natural frequencies and mode shapes."),
        "dynamics response": ("statics.response", "Compute a frequency response."),
    },
    "Verification": {
        "validate": ("validate.validate", "Check formulas, loop equations and MuJoCo models."),
        "certify": ("certify.certify", "Prove one assembly and no singularity over a range."),
        "tradeoff": ("tradeoff.tradeoff", "Measure speed and accuracy of MuJoCo's settings."),
        "extremes": ("extremes.extremes", "Find where a mechanism or its simulation breaks."),
        "doctor": ("doctor.doctor", "Report what this machine lacks."),
    },
    "MJCF scenes": {
        "tune": ("tune.tune", "Find the cheapest settings that satisfy a tolerance."),
        "reduce": ("reduce.reduce", "Find the smallest scene that satisfies a tolerance."),
    },
    "Design": {
        "sweep": ("sweep.sweep", "Measure many designs of a mechanism."),
        "sensitivity": ("sensitivity.sensitivity", "Differentiate by dimensions; propagate tolerances."),
        "fit": ("fit.fit", "Identify dimensions from measured motion."),
        "synthesize": ("synthesize.synthesize", "Find a looper whose coupler point follows a line."),
    },
    "Code": {
        "compile": ("compile.compile_solver", "Write a solver as a C header, JavaScript or FMU."),
    },
    "Pictures": {
        "plot": ("plot.plot", "Plot motions, curves, errors and quantities."),
        "render": ("render.render", "Draw or animate a mechanism without a screen."),
        "view": ("view.view", "Write an interactive 3-D page of a mechanism."),
    },
    "Other": {
        "mcp": ("mcp.serve", "Serve the commands as tools for agents."),
        "schema": ("schema.schema", "Print JSON Schemas of TOML files and --json outputs."),
    },
}
COMMANDS = {name: entry for group in GROUPS.values() for name, entry in group.items()}
# sub-command of dynamics -> options that selected it when dynamics was one command; the others are of inverse
FORMER = {
    "statics": "--statics --assemblies",
    "modes": "--modes",
    "response": "--response",
    "forward": "--initial --until --free --motor --of --budget",
}
# commands that import MuJoCo only when they run, so that their help does not need it
LATE = ("doctor", "extremes", "view")
PLAIN: dict[str, Any] = {
    "rich_markup_mode": None,
    "pretty_exceptions_enable": False,
    "context_settings": {"help_option_names": ["-h", "--help"]},
}


class LazyCommands(TyperGroup):
    """Commands, listed in groups, whose modules are imported when they are used."""

    # first words of the names of the commands
    prefix: ClassVar[str] = ""

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters."""
        return _converted_late(super().get_params(ctx))

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a list of commands for each group."""
        for group, commands in GROUPS.items():
            own = {name: line for name, (_, line) in commands.items() if name.startswith(self.prefix)}
            if rows := [(name.removeprefix(self.prefix), line) for name, line in own.items()]:
                with formatter.section(group):
                    formatter.write_dl(rows)
        with formatter.section("Examples"):
            for line in FIRST_STEPS[self.prefix]:
                formatter.write(f"  {line}\n")

    def resolve_command(self, ctx: Any, args: list[str]) -> tuple[str | None, Any, list[str]]:
        """Return the command named by the first words, and its arguments."""
        if self.prefix and args[0] not in self.commands and not ctx.resilient_parsing:
            former = {arg.partition("=")[0] for arg in args}
            name = next((name for name, old in FORMER.items() if former & {*old.split()}), "inverse")
            flags = ("--statics", "--modes", "--response", "--free")
            text = shlex.join(arg for arg in args if arg not in flags)
            text = text.replace("--speed ", "--initial crank.v=") if "--free" in former else text
            names = ", ".join(self.commands)
            raise InputError(f"dynamics has the sub-commands {names}; write: mechsim dynamics {name} {text}")
        name, _, rest = super().resolve_command(ctx, args)
        return name, None if name is None else load_command(self.prefix + name), rest


class DynamicsCommands(LazyCommands):
    """The sub-commands of `mechsim dynamics`."""

    prefix = "dynamics "


def load_command(name: str) -> Any:
    """Return the typer command of a command."""
    if name == "dynamics":
        return get_command(_group(DynamicsCommands, DYNAMICS))
    module, _, attribute = COMMANDS[name][0].partition(".")
    function: Callable[..., None] = getattr(import_module(f"mechsim.cli.{module}"), attribute)
    if name in LATE or "mujoco" in sys.modules:
        function = _without_mujoco_log(function)
    app = typer.Typer(add_completion=False, **PLAIN)
    app.command(name.split()[-1], cls=PlainCommand)(function)
    return get_command(app)


def _without_mujoco_log(function: Callable[..., None]) -> Callable[..., None]:
    """Return a function that runs with MuJoCo's output and log disabled."""

    @wraps(function)
    def run(**values: Any) -> None:
        from mechsim.simulation.mujoco_loading import PROBLEM, quiet

        if PROBLEM:
            print_stderr(f"mechsim: {PROBLEM}")
        quiet()(function)(**values)

    return run


def _group(cls: type[LazyCommands], text: str) -> typer.Typer:
    """Return the group of the commands whose names have its prefix."""
    group = typer.Typer(cls=cls, help=text, add_completion=not cls.prefix, **PLAIN)
    # a former spelling may begin with an option
    group.info.context_settings = PLAIN["context_settings"] | {"ignore_unknown_options": bool(cls.prefix)}
    own = (name.removeprefix(cls.prefix) for name in COMMANDS if name.startswith(cls.prefix))
    for name in dict.fromkeys(name.split()[0] for name in own):
        group.command(name)(lambda: None)
    return group


ABOUT = "Check models of closed-loop mechanisms: formulas, MJCF, URDF and TOML."
DYNAMICS = "Compute torques, runs from an initial state, equilibria and vibrations."
app = _group(LazyCommands, ABOUT)


@app.callback(invoke_without_command=True)
def _top(
    context: typer.Context, version: bool = typer.Option(False, "--version", help="Print the version.")
) -> None:
    """Check models of closed-loop mechanisms: formulas, MJCF, URDF and TOML."""
    for word in sys.argv[1:]:
        # Python reads bytes outside UTF-8 as surrogates, which MuJoCo and written files reject
        if word.encode(errors="ignore").decode() != word:
            raise InputError(f"{word!r} is not text in UTF-8; rename the file")
    if version:
        typer.echo(__version__)
        raise typer.Exit
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def main() -> None:
    """Run the command line; see `exit_codes.exit_code` for its exit codes."""
    # all matrices are small: threads of the linear algebra library would slow down those of mechsim
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # MuJoCo would load a window library, 60 ms; `pictures.render.gl_backend` chooses what draws pictures
    os.environ.setdefault("MUJOCO_GL", "off")
    sys.exit(exit_code(lambda: app(standalone_mode=False)))
