"""Fields of a dataclass that declare what a setting is, which values it takes and how others are refused."""

from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.maths import given


def choice(default: str, options: tuple[str, ...], doc: str, **told: Any) -> Any:
    """Declare a setting that takes one of a few words."""
    return field(default=default, metadata={"options": options, "doc": doc, **told})


def switch(default: bool, doc: str) -> Any:
    """Declare a setting that is on or off."""
    return field(default=default, metadata={"doc": doc})


def number(
    default: float | None,
    doc: str,
    *,
    unit: str = "1",
    least: float = np.nextafter(0.0, 1.0),
    remedy: str = "{name} is {value}; give a finite number above 0",
    **told: Any,
) -> Any:
    """Declare a setting that is a finite number."""
    return field(
        default=default, metadata={"unit": unit, "least": least, "remedy": remedy, "doc": doc, **told}
    )


def numbers(default: tuple[float, ...] | None, count: int, doc: str, **told: Any) -> Any:
    """Declare a setting that is so many finite numbers."""
    return field(default=default, metadata={"count": count, "doc": doc, **told})


def check(name: str, value: Any, rule: Mapping[str, Any]) -> None:
    """Raise InputError for what the declaration of a setting does not allow."""
    if "options" in rule and value not in rule["options"]:
        raise InputError(f"there is no {name} {value!r}; known are {', '.join(rule['options'])}")
    if "least" in rule and not rule["least"] <= given.number(value) < np.inf:
        raise InputError(rule["remedy"].format(name=name, value=value))
    if "count" in rule:
        values = given.numbers(value)
        if values.shape != (rule["count"],) or not np.isfinite(values).all():
            raise InputError(f"{name} is {value}; give {rule['count']} finite numbers")
