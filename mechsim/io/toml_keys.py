"""The keys of a mechanism in TOML: a JSON Schema for the reader, for `mechsim schema` and for editors.

`unit` states the unit of a number: an SI unit, or "joint" for that of the joint's coordinate, which
the reader of the key knows. A number may be text with a unit, or an expression of parameters; with `over` it
may also be a function of t or of the crank angle.
"""

import json
from functools import cache
from pathlib import Path
from typing import Any

from mechsim.mechanism.joint_kinds import ALIASES, KINDS

# a JSON Schema, whose references are resolved
Key = dict[str, Any]
SCHEMA = Path(__file__).with_name("mechanism.schema.json")


@cache
def schema() -> Key:
    """Return the JSON Schema of a mechanism's file."""
    read = json.loads(SCHEMA.read_text(encoding="utf-8"))
    read["$defs"]["joint"]["properties"]["kind"]["enum"] = [*KINDS, *ALIASES, "curve", "cam"]
    return read


@cache
def root() -> Key:
    """Return the key of a whole file: its schema with the definitions in place of references."""
    return resolved(schema(), schema()["$defs"])


def resolved(node: Any, definitions: Key) -> Any:
    """Return a schema with definitions in place of references, whose other entries are kept."""
    if isinstance(node, list):
        return [resolved(entry, definitions) for entry in node]
    if not isinstance(node, dict):
        return node
    own = {
        name: resolved(entry, definitions) for name, entry in node.items() if name not in ("$ref", "$defs")
    }
    if "$ref" not in node:
        return own
    return resolved(definitions[node["$ref"].rpartition("/")[2]], definitions) | own
