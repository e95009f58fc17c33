"""Fields of a dataclass that declare what a setting is, which values it takes and how others are refused."""

from collections.abc import Mapping
from dataclasses import field
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.numerics import inputs


def choice(default: str | None, options: tuple[str, ...], about: str, **told: Any) -> Any:
    """Declare a setting that takes one of a few words."""
    return setting(default, about, options=options, **told)


def switch(default: bool, about: str, **told: Any) -> Any:
    """Declare a setting that is on or off."""
    return setting(default, about, **told)


def number(
    default: float | None,
    about: str,
    *,
    least: float = np.nextafter(0.0, 1.0),
    remedy: str = "{name} is {value}; give a finite number above 0",
    **told: Any,
) -> Any:
    """Declare a setting that is a finite number, and how another is refused."""
    return setting(default, about, least=least, remedy=remedy, **told)


def numbers(
    default: tuple[float, ...] | None, count: int, about: str, *, fewest: int | None = None, **told: Any
) -> Any:
    """Declare a setting that is so many finite numbers; those after the fewest need not be written."""
    return setting(default, about, count=count, fewest=fewest or count, **told)


def setting(default: Any, about: str, **told: Any) -> Any:
    """Declare a setting.

    Args:
        default: where nothing else is said.
        about: what it is.
        told: `doc`, its help where it is an option of the command line, with the keys of `units.option`;
            `row`, its name and what makes its text, where a report tells it; what values it takes.
    """
    shown = {"unit": None, "read": None, "text": None, "name": None, "metavar": None, "many": False}
    return field(default=default, metadata={"about": about, **shown, **told})


def check(name: str, value: Any, rule: Mapping[str, Any]) -> None:
    """Raise InputError for what the declaration of a setting does not allow."""
    if "options" in rule and value not in rule["options"]:
        raise InputError(f"there is no {name} {value!r}; known are {', '.join(rule['options'])}")
    if "least" in rule and not rule["least"] <= inputs.number(value) < np.inf:
        raise InputError(rule["remedy"].format(name=name, value=value))
    if "count" in rule:
        values = inputs.numbers(value)
        if values.shape != (rule["count"],) or not np.isfinite(values).all():
            raise InputError(f"{name} is {value}; give {rule['count']} finite numbers")
