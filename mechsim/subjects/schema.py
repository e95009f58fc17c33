"""JSON Schema of a mechanism in TOML, made from the table of keys that the reader goes by."""

from typing import Any

from mechsim.subjects.key_kinds import Amount, Choice, Course, Key, Keys, Named, Number, Several, Truth, Word
from mechsim.subjects.toml_keys import ROOT


def schema() -> dict[str, Any]:
    """Return the JSON Schema by which an editor completes and checks a mechanism's file."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "A mechanism for mechsim"}
    return head | _of(ROOT)


def _of(key: Key) -> dict[str, Any]:
    match key:
        case Number(unit=unit):
            return {"description": f"{key.about} [{unit}]", "type": ["number", "string"]}
        case Course(unit=unit):
            about = f"{key.about} [{unit}], an expression of t or angle, or FILE.csv"
            return {"description": about, "type": ["number", "string"]}
        case Amount():
            return {"description": key.about, "type": ["number", "string"]}
        case Truth():
            return {"description": key.about, "type": "boolean"}
        case Word(options=options):
            listed: dict[str, Any] = {"enum": list(options)} if options else {}
            return {"description": key.about, "type": "string"} | listed
        case Several(of=of, count=count):
            bounds = {} if count is None else {"minItems": count, "maxItems": count}
            return {"description": key.about, "type": "array", "items": _of(of)} | bounds
        case Named(of=of):
            return {"description": key.about, "type": "object", "additionalProperties": _of(of)}
        case Keys(keys=keys, required=required):
            properties = {name: _of(one) for name, one in keys.items()}
            shape: dict[str, Any] = {
                "type": "object",
                "properties": properties,
                "additionalProperties": False,
            }
            return {"description": key.about} | shape | ({"required": list(required)} if required else {})
        case Choice(of=of):
            return {"description": key.about, "anyOf": [_of(one) for one in of]}
