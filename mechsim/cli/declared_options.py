"""Options that dataclasses declare (see `units.option`): a command takes the dataclass, people its fields."""

import inspect
from collections.abc import Callable
from dataclasses import Field, fields, is_dataclass
from functools import wraps
from typing import Annotated, Any, get_args, get_type_hints

import typer

from mechsim import units
from mechsim.errors import InputError


def spread(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command whose parameters that are dataclasses are given as options, one for each field.

    Fields that declare nothing are no options and keep their defaults. A parameter annotated
    `Annotated[Mapping[str, Any], cls]` takes, by field, what was written and nothing else.
    """
    shown: list[inspect.Parameter] = []
    made: dict[str, tuple[Callable[..., Any], list[Field[Any]], bool]] = {}
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        cls, only_written = _declaring(parameter.annotation)
        if cls is not None:
            declared = [field for field in fields(cls) if "doc" in field.metadata]
            made[parameter.name] = dict if only_written else cls, declared, only_written
            types = get_type_hints(cls)
            shown += [_parameter(field, types[field.name], only_written) for field in declared]
        else:
            shown.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))

    @wraps(command)
    def run(**given: Any) -> None:
        for name, (make, declared, only_written) in made.items():
            written = {field: given.pop(field.name) for field in declared}
            given[name] = make(
                **{
                    field.name: _value(field, text)
                    for field, text in written.items()
                    if not (only_written and text is None)
                }
            )
        command(**given)

    run.__signature__ = inspect.Signature(shown)  # pyright: ignore[reportAttributeAccessIssue]
    run.__annotations__ = {}
    return run


def _declaring(annotation: Any) -> tuple[Any, bool]:
    """Return the dataclass that a parameter stands for, if any, and whether only what was written goes in."""
    if is_dataclass(annotation):
        return annotation, False
    parts = get_args(annotation)
    if len(parts) == 2 and is_dataclass(parts[1]):
        return parts[1], True
    return None, False


def _parameter(field: Field[Any], kind: Any, only_written: bool) -> inspect.Parameter:
    rule, default = field.metadata, field.default
    if rule["many"]:
        kind, default = list[str] | None, None
    elif rule["unit"] or rule["read"] or "count" in rule:
        kind, default = (str, rule["text"]) if rule["text"] else (str | None, None)
    elif isinstance(default, bool):
        kind = bool
    if only_written:
        kind, default = kind | None, None
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
    name = rule["name"] or f"--{field.name.replace('_', '-')}"
    if "count" in rule:
        return _numbers(name, written, field)
    if rule["unit"]:
        return units.parse(written, rule["unit"], name)
    return written


def _numbers(name: str, written: str, field: Field[Any]) -> tuple[float, ...]:
    """Return so many numbers with commas; those that may be left out at the end are the default's."""
    values = units.parse_vector(written, "1", name)
    least, most = field.metadata["fewest"], field.metadata["count"]
    if not least <= len(values) <= most:
        wanted = str(least) if least == most else f"{least} to {most}"
        raise InputError(f"{name} is {written!r}, {len(values)} numbers; give {wanted}, with commas")
    default: tuple[float, ...] = field.default if isinstance(field.default, tuple) else ()
    return values + default[len(values) :]
