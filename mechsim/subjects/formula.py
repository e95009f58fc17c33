"""The formula that a mechanism's file names: the user's own model of its motion, as a function."""

import inspect
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.analytic.forms import Form
from mechsim.errors import InputError
from mechsim.maths.arrays import Array
from mechsim.subjects.python_object import object_of, tried

# crank angles (n,), or driver -> its coordinate (n,)
Asked = Array | Mapping[str, Array]
Formula = Callable[[Asked], Mapping[str, Array]]


def formula_of(form: Form) -> Formula | None:
    """Return a mechanism's formula, crank angles (n,) -> point -> (n, 3) in [m]; None where it has none.

    The Python file it stands in is run. Its function takes crank angles (n,) in [rad], or of several drivers
    the coordinates by name in [rad] and [m], and, where it has a second argument, the parameters of the
    mechanism's file as written there.

    Raises:
        InputError: for a file that cannot be run or has no such function; later, for one that fails or gives
            anything but the places of points that are tracked.
    """
    if not isinstance(form, LoopForm) or not form.formula:
        return None
    what, function = f"{form.formula} of {form.name}", object_of(form.formula)
    if not callable(function):
        raise InputError(f"{what} is of type {type(function).__name__}; name a function")
    given = (dict(form.parameters),) if _takes_parameters(function) else ()

    def places(asked: Asked) -> Mapping[str, Array]:
        several = isinstance(asked, Mapping)
        own = {name: one.copy() for name, one in asked.items()} if several else asked.copy()
        with np.errstate(all="ignore"):
            found = tried(what, lambda: function(own, *given))
        by_name = asked if several else {"crank angle": asked}
        return _checked(what, found, tuple(form.mechanism.points), by_name)

    return places


def formula_file(form: Form) -> str:
    """Return the Python file of a mechanism's formula; empty where it has none."""
    return form.formula.rpartition(":")[0] if isinstance(form, LoopForm) else ""


def _takes_parameters(function: Callable[..., Any]) -> bool:
    kinds = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    try:
        taken = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return False
    return sum(one.kind in kinds for one in taken) > 1


def _checked(what: str, found: Any, known: tuple[str, ...], asked: Mapping[str, Array]) -> dict[str, Array]:
    if not isinstance(found, Mapping) or not found:
        raise InputError(
            f"{what} gives a {type(found).__name__}; give a dictionary from points to places (n, 3)"
        )
    checked: dict[str, Array] = {}
    count = len(next(iter(asked.values())))
    for name, value in found.items():
        if name not in known:
            raise InputError(f"{what} gives point {name!r}; tracked are {', '.join(known) or 'none'}")
        try:
            place = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            place = np.empty(0)
        if place.shape != (count, 3):
            raise InputError(
                f"{what} gives point {name!r} of shape {place.shape} for {count} instants; give ({count}, 3)"
            )
        known_at = np.isfinite(place).all(1)
        if not known_at.all():
            first = np.argmin(known_at)
            where = ", ".join(f"{driver} = {value[first]:.6g}" for driver, value in asked.items())
            raise InputError(
                f"{what} gives no finite place for point {name!r} at {where}; "
                "give one wherever the mechanism can stand"
            )
        checked[name] = place
    return checked
