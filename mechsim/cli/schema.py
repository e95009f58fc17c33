"""Command `mechsim schema`: JSON Schemas of TOML files, and of --json outputs by their types.

The output of a command is a record, or a TypedDict in its module; shared types are below. Numbers that
JSON does not have are null.
"""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import is_dataclass
from inspect import get_annotations
from types import SimpleNamespace, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    NotRequired,
    TypedDict,
    Union,
    get_args,
    get_origin,
    get_type_hints,
    is_typeddict,
)

import typer

from mechsim import files
from mechsim.cli.command import command, data_type
from mechsim.cli.motion_warnings import AccuracyWarning
from mechsim.cli.output import print_json
from mechsim.errors import InputError
from mechsim.model.finding import Finding, Outcome
from mechsim.model.masses import LinkMass

Schema = dict[str, Any]
SCALARS: dict[Any, Schema] = {
    str: {"type": "string"},
    int: {"type": "integer"},
    bool: {"type": "boolean"},
    float: {"type": ["number", "null"]},
    Any: {},
    type(None): {"type": "null"},
}
# setting -> value: a number, a word or a list of numbers
Settings = dict[str, Any]


class WithMasses(TypedDict):
    """Masses of the links, if a command uses them."""

    masses: NotRequired[list[LinkMass]]


class Written(WithMasses):
    """A written file about a mechanism."""

    mechanism: str
    output: str


class RunJson(TypedDict):
    """A run of MuJoCo, as `simulate` prints it."""

    mechanism: str
    outcome: Outcome
    tolerance: float
    estimate: float
    steps: int
    seconds: float
    method: Literal["pose", "step"]
    note: str
    settings: Settings
    output: str | None
    rows: int
    few_digits: NotRequired[AccuracyWarning | None]
    findings: NotRequired[list[Finding]]


def schema_of(kind: Any) -> Schema:
    """Return the JSON Schema of a type: scalars, lists, dicts, literals, unions, TypedDicts, dataclasses."""
    if kind in SCALARS:
        return dict(SCALARS[kind])
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Literal:
        return {"enum": list(arguments)}
    if origin in (NotRequired, Annotated):
        return schema_of(arguments[0])
    if origin in (Union, UnionType):
        return {"anyOf": [schema_of(item) for item in arguments]}
    if origin in (dict, Mapping):
        return {"type": "object", "additionalProperties": schema_of(arguments[1])}
    if origin in (list, tuple, Sequence):
        return {"type": "array", "items": schema_of(arguments[0])}
    if is_dataclass(kind):
        assert isinstance(kind, type)
        hints = {key: _type_of(kind, name) for key, name in files.json_names(kind).items()}
        required = set(hints)
    elif is_typeddict(kind):
        hints, required = get_type_hints(kind), kind.__required_keys__
    else:
        raise TypeError(f"no JSON Schema of {kind!r}")
    return {
        "type": "object",
        "properties": {name: schema_of(hint) for name, hint in hints.items()},
        "required": [name for name in hints if name in required],
    }


def _type_of(record: type, name: str) -> Any:
    """Return the type of a field or property of a record."""
    owner = next((each for each in record.__mro__ if name in get_annotations(each)), None)
    if owner is None:
        return get_type_hints(getattr(record, name).fget)["return"]
    # this annotation alone: others may name types that are imported for type checkers only
    stated = SimpleNamespace(__annotations__={name: owner.__annotations__[name]})
    return get_type_hints(stated, vars(sys.modules[owner.__module__]))[name]


def output_types() -> dict[str, Any]:
    """Return the type of the --json output of each command."""
    from mechsim.cli import COMMANDS, command_function

    functions: dict[str, Callable[..., None]] = {name: command_function(name) for name in COMMANDS}
    types = {name: data_type(function) for name, function in functions.items()}
    return {name: kind for name, kind in types.items() if kind is not None}


def output_schema(name: str) -> Schema:
    """Return the JSON Schema of a command's --json output; raise KeyError if it has none."""
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"What `mechsim {name} --json` prints",
        "description": "Numbers are in SI, angles in rad; null stands for a number that is not finite.",
    }
    return head | schema_of(output_types()[name])


@command
def schema(
    command_name: Annotated[
        list[str] | None,
        typer.Argument(metavar="[COMMAND]", help="Command whose --json output is described."),
    ] = None,
) -> None:
    """Print the JSON Schema of mechanisms in TOML, or of what a command prints with --json.

    Editors complete and check such files by it.

    Examples:
    mechsim schema > mechanism.schema.json
    mechsim schema dynamics inverse
    """
    from mechsim.subjects.toml_keys import schema as toml_schema

    name = " ".join(command_name) if command_name else None
    if name is not None and name not in output_types():
        raise InputError(f"there is no schema of {name!r}; choose from {', '.join(sorted(output_types()))}")
    print_json(toml_schema() if name is None else output_schema(name))
