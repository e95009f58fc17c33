"""Candidate data of a user's model: values by name at instants, from a function, checked."""

import inspect
from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.io.python_object import run_user_code
from mechsim.mechanism.links import GROUND
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_plane import PARALLEL_TOLERANCE, plane_normals
from mechsim.mechanism.quantities import quantity, unknown
from mechsim.mechanism.quantity import AXES, Quantity
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.evaluation_points import EvaluationPoints, driver_inputs

# further arguments of a user's function that receive times, or a derivative of the drivers' coordinates
TIMES, DERIVATIVES = ("t", "time"), {"speed": 1, "rate": 1, "rates": 1, "acceleration": 2}


@dataclass(frozen=True)
class Candidate:
    """Candidate values of one quantity.

    Attributes:
        quantity: the quantity.
        values: (n, k) in SI.
    """

    quantity: Quantity
    values: Array


def values_of_function(
    function: Callable[..., Any],
    evaluation: EvaluationPoints,
    who: str,
    parameters: Mapping[str, float] | None = None,
) -> list[Candidate]:
    """Return the values of a function of the drivers at evaluation points.

    Args:
        function: takes crank angles (n,), or a mapping of driver name to coordinate (n,). Arguments called
            speed, acceleration or t receive those values; any other second argument receives `parameters`.
        evaluation: the mechanism and the instants.
        who: name of the function, for messages.
        parameters: parameter name -> value, in the units of the file.

    Raises:
        InputError: for a function that fails or returns an unknown quantity.
    """
    inputs = driver_inputs(evaluation)
    where = inputs if isinstance(inputs, Mapping) else {"crank angle": inputs}
    with np.errstate(all="ignore"):
        result = run_user_code(
            who, lambda: function(deepcopy(inputs), **_further_arguments(function, evaluation, parameters))
        )
    if not isinstance(result, Mapping) or not result:
        raise InputError(
            f"{who} gives a {type(result).__name__}; give a dictionary from names to values (n, 3) or (n,)"
        )
    plane = result.get("plane")
    if isinstance(plane, str):
        result = {name: value for name, value in result.items() if name != "plane"}
    reader = QuantityReader(evaluation.solver.mechanism, who, plane if isinstance(plane, str) else "")
    return [read_candidate(str(name), value, reader, where) for name, value in result.items()]


@dataclass(frozen=True)
class QuantityReader:
    """Reads the names of the quantities of a function or a table.

    Attributes:
        mechanism: the mechanism that has these quantities.
        who: name of the function or table, for messages.
        plane: ground axes of a point given by two numbers, as "xz"; empty selects the plane of the motion.
    """

    mechanism: Mechanism
    who: str
    plane: str = ""

    def read(self, name: str, width: int | None) -> Quantity:
        """Return the quantity of a name and a number of values at each instant.

        Args:
            name: name in the function's result or the table's header.
            width: values at each instant; None for a single column (n,).

        Raises:
            InputError: for an unknown name, with the closest known one, or for a wrong width.
        """
        scalar = width in (None, 1)
        try:
            result = quantity(name, self.mechanism, scalar=scalar)
        except InputError as error:
            raise InputError(f"{self.who} gives {name!r}: {error}") from None
        if len(result.columns) > 1 and result.kind.startswith("joint"):
            raise InputError(f"{self.who} gives {name!r}: {unknown(name, self.mechanism)}")
        count = 1 if width is None else width
        if count == max(1, len(result.axes)):
            return result
        if count == 2 and result.axes == AXES:
            return result.along(self._plane(name))
        expected = (
            f"({len(result.axes)} axes: {result.axes})"
            if len(result.axes) in (1, 2)
            else "(n, 3), or (n, 2) in a plane"
        )
        shape = "(n,)" if width is None else f"(n, {width})"
        raise InputError(f"{self.who} gives {name!r} of shape {shape}; give {expected}")

    def _plane(self, name: str) -> str:
        """Return the ground axes of the plane in which points move."""
        if self.plane:
            if len(self.plane) != 2 or len(set(self.plane)) != 2 or self.plane.strip(AXES):
                raise InputError(f"the plane is {self.plane!r}; give two of the ground's axes, as in 'xy'")
            return self.plane
        normal = np.abs((plane_normals(self.mechanism) or {}).get(GROUND, np.zeros(3)))
        if not normal.max() > 1.0 - PARALLEL_TOLERANCE:
            raise InputError(
                f"{self.who} gives {name!r} by two numbers, but {self.mechanism.name} does not move in a "
                f"plane of the ground's axes; name the plane, as in '{name}.xy'"
            )
        return AXES.replace(AXES[int(np.argmax(normal))], "")


def read_candidate(name: str, value: object, reader: QuantityReader, where: Mapping[str, Array]) -> Candidate:
    """Return the candidate values of one quantity.

    Args:
        name: name in the function's result.
        value: (n,), (n, 2) or (n, 3) in SI.
        reader: reads the name.
        where: driver -> its coordinate (n,), for messages.

    Raises:
        InputError: for an unknown name, a wrong shape or values that are not finite.
    """
    who, count = reader.who, len(next(iter(where.values())))
    try:
        array = np.asarray(value)
        values = np.real(array).astype(np.float64)
    except (TypeError, ValueError):
        raise InputError(
            f"{who} gives no numbers for {name!r}; give an array of shape ({count}, 3) or ({count},)"
        ) from None
    if np.iscomplexobj(array):
        raise InputError(f"{who} gives complex numbers for {name!r}; give real numbers, as with .real")
    named = reader.read(name, None if values.ndim == 1 else values.shape[-1] if values.ndim == 2 else 0)
    width = max(1, len(named.axes))
    if values.shape not in ((count, width), (count,) if width == 1 else (count, width)):
        shape = f"({count}, {width})" if width > 1 else f"({count},)"
        raise InputError(f"{who} gives {name!r} of shape {values.shape} for {count} instants; give {shape}")
    values = values.reshape(count, width)
    valid = np.isfinite(values).all(1)
    if not valid.all():
        first = int(np.argmin(valid))
        position = ", ".join(f"{driver} = {column[first]:.6g}" for driver, column in where.items())
        raise InputError(f"{who} gives no finite value for {name!r} at {position}; give one for every pose")
    return Candidate(named, values)


def _further_arguments(
    function: Callable[..., Any], evaluation: EvaluationPoints, parameters: Mapping[str, float] | None
) -> dict[str, Any]:
    """Return the arguments of a function after the driver coordinates."""
    try:
        optional = list(inspect.signature(function).parameters.values())[1:]
    except (TypeError, ValueError):
        return {}
    arguments: dict[str, Any] = {}
    drivers = evaluation.drivers()
    for index, argument in enumerate(optional):
        if argument.kind in (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD):
            continue
        if argument.name in TIMES:
            arguments[argument.name] = evaluation.time
        elif argument.name in DERIVATIVES:
            rates = {name: state[DERIVATIVES[argument.name]].copy() for name, state in drivers.items()}
            arguments[argument.name] = next(iter(rates.values())) if len(rates) == 1 else rates
        elif parameters is not None and index == 0 and argument.default is inspect.Parameter.empty:
            arguments[argument.name] = dict(parameters)
    return arguments
