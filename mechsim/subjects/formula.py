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

Formula = Callable[[Array], Mapping[str, Array]]


def formula_of(form: Form) -> Formula | None:
    """Return a mechanism's formula, crank angles (n,) -> point -> (n, 3) in [m]; None where it has none.

    The Python file it stands in is run. Its function takes crank angles (n,) in [rad] and, where it has a
    second argument, the parameters of the mechanism's file as written there.

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

    def places(angle: Array) -> Mapping[str, Array]:
        with np.errstate(all="ignore"):
            found = tried(what, lambda: function(angle.copy(), *given))
        return _checked(what, found, tuple(form.mechanism.points), angle)

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


def _checked(what: str, found: Any, known: tuple[str, ...], angle: Array) -> dict[str, Array]:
    if not isinstance(found, Mapping) or not found:
        raise InputError(
            f"{what} gives a {type(found).__name__}; give a dictionary from points to places (n, 3)"
        )
    checked: dict[str, Array] = {}
    for name, value in found.items():
        if name not in known:
            raise InputError(f"{what} gives point {name!r}; tracked are {', '.join(known) or 'none'}")
        try:
            place = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            place = np.empty(0)
        if place.shape != (len(angle), 3):
            raise InputError(
                f"{what} gives point {name!r} of shape {place.shape} for {len(angle)} crank angles; "
                f"give ({len(angle)}, 3)"
            )
        known_at = np.isfinite(place).all(1)
        if not known_at.all():
            raise InputError(
                f"{what} gives no finite place for point {name!r} at crank angle "
                f"{angle[np.argmin(known_at)]:.6g} rad; give one wherever the mechanism can stand"
            )
        checked[name] = place
    return checked
