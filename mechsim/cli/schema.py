"""Command `mechsim schema`: JSON Schemas of TOML files and of what commands print."""

from typing import Annotated

import typer

from mechsim import files
from mechsim.cli.json_outputs import OUTPUTS, output_schema
from mechsim.cli.options import Json, Output, writable
from mechsim.cli.output import print_json
from mechsim.errors import InputError
from mechsim.subjects.schema import schema as schema_of


def schema(
    command: Annotated[
        str | None,
        typer.Argument(
            metavar="[COMMAND]", help="Whose --json output is meant; none: a mechanism's TOML file."
        ),
    ] = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Print the JSON Schema of mechanisms in TOML, or of what a command prints with --json.

    Editors complete and check such files by it.
    """
    if command is not None and command not in OUTPUTS:
        raise InputError(f"there is no schema of {command!r}; known are {', '.join(sorted(OUTPUTS))}")
    told = schema_of() if command is None else output_schema(command)
    if output is None:
        print_json(told)
        return
    files.write_json(writable(output, ".json"), told)
    if as_json:
        print_json({"output": output})
