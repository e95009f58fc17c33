"""Command `mechsim schema`: the JSON Schema of a mechanism's TOML file."""

from mechsim import files
from mechsim.cli.options import Output, writable
from mechsim.cli.output import print_json
from mechsim.subjects.schema import schema as schema_of


def schema(output: Output = None) -> None:
    """Print the JSON Schema of mechanisms in TOML.

    Editors complete and check such files by it.
    """
    if output is None:
        print_json(schema_of())
        return
    files.write_json(writable(output, ".json"), schema_of())
