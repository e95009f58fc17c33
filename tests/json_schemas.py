"""JSON that a command prints is valid under the schema of the command, and has no other keys."""

import re
import shlex
from collections.abc import Iterator, Sequence
from typing import Any

from jsonschema import Draft202012Validator

from mechsim.cli.schema import output_schema

# tables of these have a column for each of a user's quantities
OPEN = r"\.(points|pareto|recommended)\b.*"


def command_of(words: str | Sequence[str]) -> str:
    """Return the command of a line, two words for those of dynamics."""
    split = shlex.split(words) if isinstance(words, str) else [*words]
    return " ".join(split[: 2 if split[0] == "dynamics" else 1])


def valid_options(value: Any, schema: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the alternatives of a schema that a value satisfies; the schema itself without alternatives."""
    options = schema.get("anyOf", [schema])
    return [option for option in options if Draft202012Validator(option).is_valid(value)]


def undescribed(value: Any, schema: dict[str, Any], path: str = "") -> Iterator[str]:
    """Yield the paths of output keys that the schema does not describe."""
    options = valid_options(value, schema)
    described = [item for item in options if "properties" in item or "additionalProperties" in item]
    if isinstance(value, dict) and described:
        own, rest = described[-1].get("properties", {}), described[-1].get("additionalProperties")
        for key, item in value.items():
            if own.get(key, rest) is None:
                yield f"{path}.{key}"
            else:
                yield from undescribed(item, own.get(key, rest), f"{path}.{key}")
    elif isinstance(value, list):
        items = next((item["items"] for item in options if "items" in item), {})
        for item in value:
            yield from undescribed(item, items, f"{path}[]")


def check_output(words: str | Sequence[str], reported: Any) -> None:
    """Assert that a command's output is exactly one alternative of its schema, which rejects changed ones."""
    schema = output_schema(command_of(words))
    Draft202012Validator(schema).validate(reported)
    assert not [path for path in undescribed(reported, schema) if not re.match(OPEN, path)]
    (kind,) = valid_options(reported, schema)
    first = kind["required"][0]
    only = Draft202012Validator(kind)
    assert not only.is_valid({key: item for key, item in reported.items() if key != first})
    assert not only.is_valid(reported | {first: object})
