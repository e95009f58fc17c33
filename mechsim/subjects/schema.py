"""JSON Schema of a mechanism in TOML, made from the table of keys that the reader goes by."""

from typing import Any

from mechsim.subjects.key_types import (
    AnyOf,
    Boolean,
    JointNumber,
    KeyType,
    ListOf,
    Number,
    Profile,
    Table,
    TableOf,
    Text,
)
from mechsim.subjects.toml_keys import ROOT


def schema() -> dict[str, Any]:
    """Return the JSON Schema by which an editor completes and checks a mechanism's file."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "A mechanism for mechsim"}
    return head | _schema_of(ROOT)


def _schema_of(key: KeyType) -> dict[str, Any]:
    match key:
        case Number(unit=unit):
            return {"description": f"{key.about} [{unit}]", "type": ["number", "string"]}
        case Profile(unit=unit):
            about = f"{key.about} [{unit}], an expression of t or angle, or FILE.csv"
            return {"description": about, "type": ["number", "string"]}
        case JointNumber():
            return {"description": key.about, "type": ["number", "string"]}
        case Boolean():
            return {"description": key.about, "type": "boolean"}
        case Text(options=options):
            listed: dict[str, Any] = {"enum": list(options)} if options else {}
            return {"description": key.about, "type": "string"} | listed
        case ListOf(item=inner, count=count):
            bounds = {} if count is None else {"minItems": count, "maxItems": count}
            return {"description": key.about, "type": "array", "items": _schema_of(inner)} | bounds
        case TableOf(value_type=inner):
            return {"description": key.about, "type": "object", "additionalProperties": _schema_of(inner)}
        case Table(keys=keys, required=required):
            properties = {name: _schema_of(entry) for name, entry in keys.items()}
            table: dict[str, Any] = {
                "type": "object",
                "properties": properties,
                "additionalProperties": False,
            }
            return {"description": key.about} | table | ({"required": list(required)} if required else {})
        case AnyOf(alternatives=inner):
            return {"description": key.about, "anyOf": [_schema_of(entry) for entry in inner]}
