"""What somebody else's model says: values by name at instants, read from a function and checked."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.comparand import Comparand, asked_of
from mechsim.studies.agreement.named_quantities import NamedQuantity, Names
from mechsim.subjects.python_object import run_user_code

# second arguments by which a function asks for more than places of drivers
BY_NAME = {
    "speed": "rate",
    "rate": "rate",
    "rates": "rate",
    "acceleration": "second",
    "t": "time",
    "time": "time",
}


@dataclass(frozen=True)
class Claim:
    """What is said of one quantity.

    Attributes:
        named: the quantity.
        values: (n, k) in SI.
        uncertainty: standard deviations, (n, k) in SI, 0 in columns without; None without any.
    """

    named: NamedQuantity
    values: Array
    uncertainty: Array | None = None


def claimed(
    function: Callable[..., Any],
    comparand: Comparand,
    names: Names,
    who: str,
    parameters: Mapping[str, float] | None = None,
) -> list[Claim]:
    """Return what a function of the drivers says at the instants of a comparand.

    Args:
        function: of the crank's angles (n,), or the coordinates of several drivers by name; arguments called
            speed, acceleration or t get those too, and another second one the parameters of a file.
        comparand: at which instants.
        names: of the subject.
        who: the function, for messages.
        parameters: of the subject's file, as written.

    Raises:
        InputError: for a function that fails, or gives what is no quantity of the subject; one sentence.
    """
    asked = asked_of(comparand)
    where = asked if isinstance(asked, Mapping) else {"crank angle": asked}
    with np.errstate(all="ignore"):
        found = run_user_code(who, lambda: function(_copied(asked), **_more(function, comparand, parameters)))
    if not isinstance(found, Mapping) or not found:
        raise InputError(
            f"{who} gives a {type(found).__name__}; give a dictionary from names to values (n, 3) or (n,)"
        )
    plane = found.get("plane")
    if isinstance(plane, str):
        names = replace(names, plane=plane)
        found = {name: value for name, value in found.items() if name != "plane"}
    return [read(str(name), value, names, who, where) for name, value in found.items()]


def read(name: str, value: object, names: Names, who: str, where: Mapping[str, Array]) -> Claim:
    """Return one claim.

    Args:
        name: as it is given.
        value: (n,), (n, 2) or (n, 3) in SI.
        names: of the subject.
        who: gives it, for messages.
        where: driver -> its coordinate (n,), for messages.

    Raises:
        InputError: for a name, a shape or numbers that cannot be.
    """
    count = len(next(iter(where.values())))
    values = _numbers(name, value, who, count)
    named = names.read(name, None if values.ndim == 1 else values.shape[-1] if values.ndim == 2 else 0, who)
    width = max(1, len(named.axes))
    if values.shape not in ((count, width), (count,) if width == 1 else (count, width)):
        shape = f"({count}, {width})" if width > 1 else f"({count},)"
        raise InputError(f"{who} gives {name!r} of shape {values.shape} for {count} instants; give {shape}")
    values = values.reshape(count, width)
    good = np.isfinite(values).all(1)
    if not good.all():
        first = int(np.argmin(good))
        at = ", ".join(f"{driver} = {column[first]:.6g}" for driver, column in where.items())
        raise InputError(
            f"{who} gives no finite value for {name!r} at {at}; give one wherever the model can stand"
        )
    return Claim(named, values)


def _numbers(name: str, value: object, who: str, count: int) -> Array:
    try:
        array = np.asarray(value)
        values = np.real(array).astype(np.float64)
    except (TypeError, ValueError):
        raise InputError(
            f"{who} gives no numbers for {name!r}; give an array of shape ({count}, 3) or ({count},)"
        ) from None
    if np.iscomplexobj(array):
        raise InputError(f"{who} gives complex numbers for {name!r}; give real ones, as by .real")
    return values


def _copied(asked: Array | Mapping[str, Array]) -> Array | dict[str, Array]:
    return {name: one.copy() for name, one in asked.items()} if isinstance(asked, Mapping) else asked.copy()


def _more(
    function: Callable[..., Any], comparand: Comparand, parameters: Mapping[str, float] | None
) -> dict[str, Any]:
    """Return the arguments a function takes beside the coordinates of the drivers."""
    try:
        taken = list(inspect.signature(function).parameters.values())[1:]
    except (TypeError, ValueError):
        return {}
    given: dict[str, Any] = {}
    drivers = comparand.drivers()
    for place, one in enumerate(taken):
        if one.kind in (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD):
            continue
        what = BY_NAME.get(one.name)
        if what == "time":
            given[one.name] = comparand.time
        elif what is not None:
            of = {name: state[1 if what == "rate" else 2].copy() for name, state in drivers.items()}
            given[one.name] = next(iter(of.values())) if len(of) == 1 else of
        elif parameters is not None and place == 0 and one.default is inspect.Parameter.empty:
            given[one.name] = dict(parameters)
    return given
