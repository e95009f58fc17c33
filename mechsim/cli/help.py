"""Help of the commands: options in panels, types with names, and examples."""

import inspect
from types import SimpleNamespace
from typing import Any, ClassVar

from typer.core import TyperCommand, TyperGroup

EXAMPLES = "\nExamples:\n"
# examples below the list of commands
FIRST_STEPS = ("mechsim validate four_bar", "mechsim show gripper.xml", "mechsim validate --help")
# panel -> long names of its options; a command's own options come first, without a panel
PANELS = {
    "Model": "set lock lock-others fix-base key track gravity load motor gear friction spring damper "
    "flywheel density diameter scene cut",
    "Initial state": "initial until restitution controller",
    "Motion": "drive ctrl speed turns angles angle profile at every samples duration change-point free",
    "Solver": "method tolerance timestep integrator steps-per-turn constant-steps solref solimp compliance "
    "refsafe diagexact jacobian solver iterations ls-iterations residual eulerdamp island drive-inertia "
    "budget seed",
    "Output": "output units json verbose plot report csv help",
}
PANEL_OF = {name: panel for panel, names in PANELS.items() for name in names.split()}
# name of an option's type, if its declaration has none
TYPES = {
    "speed": "SPEED",
    "angle": "ANGLE",
    "angles": "ANGLE:ANGLE:ANGLE",
    "every": "ANGLE",
    "tilt": "ANGLE",
    "tolerance": "LENGTH",
    "length": "LENGTH",
    "diameter": "LENGTH",
    "timestep": "TIME",
    "duration": "TIME",
    "budget": "TIME",
    "offset": "ANGLE",
    "through": "X,Y",
    "gravity": "X,Y,Z",
    "cut": "JOINT,...",
    "solref": "NUMBERS",
    "solimp": "NUMBERS",
    "size": "WIDTHxHEIGHT",
    "scene": "LEVEL",
    "kind": "KIND",
    "by": "ERROR",
    "points": "P,...",
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


class GroupedCommands(TyperGroup):
    """Commands that are listed in groups."""

    groups: ClassVar[dict[str, tuple[str, ...]]] = {}

    def get_params(self, ctx: Any) -> list[Any]:
        """Return the parameters."""
        return _converted_late(super().get_params(ctx))

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a list of commands for each group."""
        for group, names in self.groups.items():
            with formatter.section(group):
                formatter.write_dl([(name, (self.get_command(ctx, name) or self).help) for name in names])
        with formatter.section("Examples"):
            for line in FIRST_STEPS:
                formatter.write(f"  {line}\n")
