"""Command `mechsim schema`: JSON Schemas of TOML files, and of --json outputs."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from mechsim.cli.command import command
from mechsim.cli.output import print_json
from mechsim.errors import InputError
from mechsim.io.toml_keys import resolved
from mechsim.io.toml_keys import schema as toml_schema

# the outputs of all commands by name, and the records in them; numbers that JSON does not have are null
OUTPUTS: dict[str, Any] = json.loads(
    Path(__file__).with_name("outputs.schema.json").read_text(encoding="utf-8")
)


def output_schema(name: str) -> dict[str, Any]:
    """Return the JSON Schema of a command's --json output; raise KeyError if it has none."""
    head = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": f"What `mechsim {name} --json` prints",
    }
    schema = head | resolved(OUTPUTS["properties"][name], OUTPUTS["$defs"])
    note = "Numbers are in SI, angles in rad; null stands for a number that is not finite."
    return schema | {"description": f"{schema.get('description', '')} {note}".strip()}


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
    name = " ".join(command_name) if command_name else None
    if name is not None and name not in OUTPUTS["properties"]:
        choices = ", ".join(sorted(OUTPUTS["properties"]))
        raise InputError(f"there is no schema of {name!r}; choose from {choices}")
    print_json(toml_schema() if name is None else output_schema(name))
