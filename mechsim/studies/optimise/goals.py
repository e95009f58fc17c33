"""Goals and limits of an optimisation, as functions or as measures of `mechsim sweep`, with derivatives."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.model.motion import Motion
from mechsim.model.quantity import AXES, TRANSMISSION
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.numerics.rounding import ROUNDING
from mechsim.studies.sensitivity.moved_family import MovedFamily
from mechsim.studies.sweep.measures import TurnMeasure, Turns, measure

Quantities = Mapping[str, Any]
Function = Callable[[Quantities], Any]


@dataclass(frozen=True)
class Goal:
    """A goal to minimise: the sum of squares of a function's values.

    Attributes:
        quantities: arguments of the function, named as in `model.quantities`.
        function: quantities and dimensions -> a number or numbers, in any unit.
    """

    quantities: tuple[str, ...]
    function: Function


@dataclass(frozen=True)
class Limit:
    """A limit of an optimisation: low <= function <= high, for each value.

    Attributes:
        quantities: arguments of the function; empty if it needs dimensions only.
        function: quantities and dimensions -> a number or numbers.
        low: lower bound; None for none.
        high: upper bound; None for none.
        name: for messages.
    """

    quantities: tuple[str, ...]
    function: Function
    low: float | None = None
    high: float | None = None
    name: str = "a limit"

    def __post_init__(self) -> None:
        if self.low is None and self.high is None:
            raise InputError(f"{self.name} has no bound; give low, high or both")


def largest(values: Array) -> Any:
    """Return the largest of values, with its derivative."""
    return values[int(np.argmax(np.real(values)))]


def smallest(values: Array) -> Any:
    """Return the smallest of values, with its derivative."""
    return values[int(np.argmin(np.real(values)))]


def numbers_from(result: Any, what: str) -> Array:
    """Return the values of a user's function as one row of numbers.

    Raises:
        InputError: for values that are not finite numbers.
    """
    values = np.atleast_1d(np.asarray(result)).ravel()
    if values.dtype.kind not in "fciu" or not np.isfinite(values).all():
        raise InputError(f"{what} gives {result!r}; return finite numbers")
    return values


def bounded(limits: Sequence[Limit]) -> list[tuple[Limit, float, float]]:
    """Return limits as signs and bounds, for which sign * (function - bound) >= 0."""
    lower = [(limit, 1.0, limit.low) for limit in limits if limit.low is not None]
    return lower + [(limit, -1.0, limit.high) for limit in limits if limit.high is not None]


# measure that is a root mean square -> the function whose root mean square it is
SQUARES: dict[str, Callable[[Array], Array]] = {
    "rms": lambda values: values,
    "ripple": lambda values: values - values.mean(),
}


@dataclass(frozen=True)
class MeasureLimit:
    """A limit of a measure: low <= measure <= high.

    Attributes:
        measure: measure of `mechsim sweep`, as "range:rocker".
        low: lower bound in SI; None for none.
        high: upper bound; None for none.
    """

    measure: str
    low: float | None = None
    high: float | None = None


def goal_of(text: str, moved: MovedFamily) -> Goal:
    """Return the goal that minimises a measure of `mechsim sweep` over the same poses.

    For rms and ripple the goal has one number for each pose, which least squares needs.

    Raises:
        InputError: for an unknown measure, or one without a derivative.
    """
    measured = _measured(text, moved)
    if measured.measure.kind in SQUARES:
        alike = SQUARES[measured.measure.kind]
        return Goal(measured.quantities, lambda values: alike(measured.over(values)))
    return Goal(measured.quantities, measured.value)


def limit_of(limit: MeasureLimit, moved: MovedFamily) -> Limit:
    """Return the limit of a measure; as for `goal_of`."""
    measured = _measured(limit.measure, moved)
    return Limit(measured.quantities, measured.value, limit.low, limit.high, limit.measure)


@dataclass(frozen=True)
class _Measured:
    """A measure, and the poses that it needs.

    Attributes:
        measure: the measure.
        poses: indices of its poses; without the last one of a full revolution, which equals the first.
        index: of the pose at its angle; None for the whole motion.
    """

    measure: TurnMeasure
    poses: slice
    index: int | None

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns that it needs."""
        quantity = self.measure.quantity
        if quantity is None:
            return tuple(f"{self.measure.subject}.{axis}" for axis in AXES)
        return tuple(component.name for component in quantity.scalars())

    @property
    def quantities(self) -> tuple[str, ...]:
        """Names of the quantities that it needs; for a vector all determined components."""
        quantity = self.measure.quantity
        return (quantity.name,) if quantity and len(self.columns) > 1 else self.columns

    def over(self, values: Quantities) -> Array:
        """Return the values of its quantity at the poses."""
        assert self.measure.quantity is not None
        return self._turns(values).values(self.measure.quantity)[0]

    def value(self, values: Quantities) -> Any:
        """Return the measure."""
        return self.measure.value(self._turns(values), self.index)[0]

    def _turns(self, values: Quantities) -> Turns:
        """Return quantities as motions of a single design."""
        determined = {
            name: np.asarray(values[name])[self.poses][None] for name in self.columns if name in values
        }
        zeros = np.zeros_like(np.real(next(iter(determined.values()))))
        # components that rigid links leave undetermined count as zero
        more = {name: determined.get(name, zeros) for name in self.columns}
        return Turns(1, zeros.size, Motion("user", zeros[0], zeros[0], zeros[0], {}), more)


def _measured(text: str, moved: MovedFamily) -> _Measured:
    solver, angles = moved.solver, moved.angles
    measured = measure(text, solver.mechanism, solver.motion_laws)
    if (
        not measured.turns
        or measured.kind == "function"
        or (measured.quantity and measured.quantity.kind == TRANSMISSION)
    ):
        raise InputError(
            f"{text} has no derivative by dimensions; write a function of columns as Goal or Limit, "
            "as in examples/design/torque_ripple.py"
        )
    whole = solver.motion_laws.crank and abs(angles[-1] - angles[0] - REVOLUTION) < ROUNDING
    index = None
    if measured.angle is not None:
        distance = np.abs(angles - measured.angle)
        index = int(np.argmin(distance))
        if distance[index] > ROUNDING:
            raise InputError(
                f"{text} is at {solver.motion_laws.instant_label(measured.angle)}, where the motion is "
                "not solved; add this instant to those of `moved`"
            )
        whole = False
    return _Measured(measured, slice(0, -1) if whole else slice(None), index)
