"""Options that dataclasses declare (see `units.option`): a command takes the dataclass, people its fields."""

import inspect
from collections.abc import Callable
from dataclasses import Field, fields, is_dataclass
from functools import wraps
from typing import Annotated, Any, cast, get_type_hints

import typer

from mechsim import units


def spread(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command whose parameters that are dataclasses are given as options, one for each field.

    Fields that declare nothing are no options and keep their defaults.
    """
    shown: list[inspect.Parameter] = []
    made: dict[str, tuple[type, list[Field[Any]]]] = {}
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        if is_dataclass(cls := parameter.annotation):
            declared = [field for field in fields(cls) if "doc" in field.metadata]
            made[parameter.name] = cast(type, cls), declared
            types = get_type_hints(cls)
            shown += [_parameter(field, types[field.name]) for field in declared]
        else:
            shown.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))

    @wraps(command)
    def run(**given: Any) -> None:
        for name, (cls, declared) in made.items():
            written = {field: given.pop(field.name) for field in declared}
            given[name] = cls(**{field.name: _value(field, text) for field, text in written.items()})
        command(**given)

    run.__signature__ = inspect.Signature(shown)  # pyright: ignore[reportAttributeAccessIssue]
    run.__annotations__ = {}
    return run


def _parameter(field: Field[Any], kind: Any) -> inspect.Parameter:
    rule, default = field.metadata, field.default
    if rule["many"]:
        kind, default = list[str] | None, None
    elif rule["unit"] or rule["read"]:
        kind, default = (str, rule["text"]) if rule["text"] else (str | None, None)
    elif isinstance(default, bool):
        kind = bool
    names = (rule["name"],) if rule["name"] else ()
    said = typer.Option(*names, metavar=rule["metavar"], help=rule["doc"])
    return inspect.Parameter(
        field.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=Annotated[kind, said]
    )


def _value(field: Field[Any], written: Any) -> Any:
    """Return the value of a field from what was written; its default where nothing was."""
    rule = field.metadata
    if written is None:
        return field.default
    if rule["many"]:
        return tuple(rule["read"](one) for one in written)
    if rule["read"]:
        return rule["read"](written)
    if rule["unit"]:
        return units.parse(written, rule["unit"], rule["name"] or f"--{field.name.replace('_', '-')}")
    return written
