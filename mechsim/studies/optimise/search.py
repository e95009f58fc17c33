"""Optimisation of dimensions: scipy's `least_squares`, or `minimize` with SLSQP if there are limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from mechsim.errors import AssemblyError, InputError
from mechsim.model.motion import short_repr
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import numbers
from mechsim.numerics.jets import change_of, stepped
from mechsim.studies.optimise.goals import (
    Function,
    Goal,
    Limit,
    MeasureLimit,
    bounded,
    goal_of,
    limit_of,
    numbers_from,
)
from mechsim.studies.sensitivity.moved_family import MovedFamily, QuantityDerivatives, family_at
from mechsim.studies.sensitivity.sensitivity import Subject, dimension_names, moved

# largest number of mechanisms that are solved; largest violation of a limit, relative to its bound
MAX_MECHANISMS, LIMIT_TOLERANCE = 300, 1e-6
# value of a goal without an assembly, relative to that at the start
GOAL_WITHOUT_ASSEMBLY = 1e6
# relative change at convergence; smallest initial distance from a bound; distance that counts as at a bound
CONVERGENCE_TOLERANCE, START_MARGIN, BOUND_TOLERANCE = 1e-10, 1e-6, 1e-9
GOAL = "the goal"

SearchOutcome = Literal["found", "not converged", "limits missed"]


@dataclass(frozen=True)
class Optimum:
    """Dimensions that minimise a goal near the start.

    Attributes:
        moved: the mechanism with these dimensions.
        outcome: "limits missed" if no dimensions satisfy the limits.
        start: dimension -> initial value, in SI.
        values: dimension -> optimal value.
        before: root mean square of the goal at the start.
        after: root mean square of the goal at the optimum.
        limits: name of a limit -> its value closest to a bound, at the optimum.
        at_bounds: dimensions at their bounds.
        tried: number of mechanisms solved.
        message: message of the optimiser.
    """

    moved: MovedFamily
    outcome: SearchOutcome
    start: Mapping[str, float]
    values: Mapping[str, float]
    before: float
    after: float
    limits: Mapping[str, float]
    at_bounds: tuple[str, ...]
    tried: int
    message: str

    __repr__ = short_repr


def optimise(
    model: Subject,
    vary: Mapping[str, tuple[float, float]],
    goal: Goal | str,
    limits: Sequence[Limit | MeasureLimit] = (),
    *,
    most: int = MAX_MECHANISMS,
) -> Optimum:
    """Return the dimensions near the initial ones that minimise a goal.

    Without limits scipy's `least_squares` (trust region) is used, with limits `minimize` with SLSQP, both
    with exact derivatives of the motion. They find a local minimum only: if there may be others, start from
    several mechanisms.

    Args:
        model: as for `moved`; angles, speed and forces are those of `moved`.
        vary: dimension -> lowest and highest value in SI.
        goal: to minimise: a measure of `mechsim sweep` ("ripple:torque", "range:rocker"), or a function.
        limits: limits of measures or functions. The closure of the loops at every angle is always a limit: a
            crank with angles over a revolution turns fully.
        most: largest number of mechanisms that are solved.

    Raises:
        InputError: for an unknown dimension, measure or quantity, a measure without derivative, bounds in
            descending order or without the start, or a function that loses derivatives.
        AssemblyError: if the initial mechanism cannot be assembled at every angle.
    """
    subject = moved(model)
    objective = goal_of(goal, subject) if isinstance(goal, str) else goal
    constraints = [limit_of(limit, subject) if isinstance(limit, MeasureLimit) else limit for limit in limits]
    search = _DimensionSearch(subject, vary, objective, constraints)
    search.evaluated(search.initial)
    solution = search.constrained(most) if limits else search.free(most)
    return search.result(solution)


@dataclass(frozen=True)
class _Evaluated:
    """Quantities and derivatives of one mechanism; None without an assembly."""

    x: Array
    derivatives: QuantityDerivatives | None


class _DimensionSearch:
    """The functions that scipy needs, with dimensions relative to their ranges."""

    def __init__(
        self,
        subject: MovedFamily,
        vary: Mapping[str, tuple[float, float]],
        goal: Goal,
        limits: Sequence[Limit],
    ):
        self.moved, self.goal, self.limits = subject, goal, limits
        names = dimension_names(subject, [*vary])
        if names != [*vary]:
            raise InputError(f"a whole position cannot vary; name its components, {', '.join(names)}")
        if not names:
            raise InputError("no dimension may vary; name some with their lowest and highest values")
        subject.designs.require_independent(names)
        self.names = names
        ends = [_ends(subject, name, vary[name]) for name in self.names]
        self.low, self.high = np.array(ends).T
        self.start = np.array([subject.designs.dimensions[name].value for name in self.names])
        self.initial = (self.start - self.low) / (self.high - self.low)
        by_limits = (name for limit in limits for name in limit.quantities)
        requested = dict.fromkeys([*goal.quantities, *by_limits])
        self.columns = subject.quantities([*requested]) if requested else []
        self.tried = 0
        self._last: _Evaluated | None = None
        self.scale = 1.0
        self.scale = float(np.abs(self.values(goal.function, self.initial, GOAL)).max()) or 1.0

    def dimensions(self, x: Array) -> dict[str, float]:
        """Return dimensions in SI."""
        values = self.low + x * (self.high - self.low)
        return dict(zip(self.names, values.tolist(), strict=True))

    def evaluated(self, x: Array) -> QuantityDerivatives:
        """Return quantities and their derivatives.

        Raises:
            AssemblyError: for dimensions without an assembly.
        """
        if self._last is not None and np.array_equal(self._last.x, x):
            if self._last.derivatives is None:
                raise AssemblyError(
                    f"{self.moved.designs.name}: the loops do not close with these dimensions"
                )
            return self._last.derivatives
        self.tried += 1
        self._last = _Evaluated(x.copy(), None)
        dimensions = self.dimensions(x)
        try:
            result = (
                self.moved.derivatives(self.columns, self.names, dimensions)
                if self.columns
                else QuantityDerivatives({}, {})
            )
        except InputError as error:
            # dimensions outside the valid range of the mechanism
            raise AssemblyError(str(error)) from None
        self._last = _Evaluated(x.copy(), result)
        return result

    def values(self, function: Function, x: Array, what: str) -> Array:
        """Return a function's values, (k,)."""
        quantities = self.evaluated(x).values
        return numbers_from(function({**self._all(x), **quantities}), what)

    def derivative(self, objective: Goal | Limit, x: Array, what: str) -> Array:
        """Return derivatives of a goal or a limit by the scaled dimensions, (k, p)."""
        evaluated, rows = self.evaluated(x), list[Array]()
        for i, name in enumerate(self.names):
            width = self.high[i] - self.low[i]
            own = {
                column: stepped(values, evaluated.by[name][column] * width)
                for column, values in evaluated.values.items()
            }
            arguments: dict[str, Any] = self._all(x)
            arguments[name] = stepped(np.array(arguments[name]), width)
            result = numbers_from(objective.function({**arguments, **own}), what)
            if objective.quantities and not np.iscomplexobj(result):
                raise InputError(
                    f"{what} loses the derivative, as abs, max and float do; "
                    "use sums, products, powers, roots, and `largest`, `smallest` or `size_of`"
                )
            rows.append(change_of(result))
        return np.array(rows).T

    def _all(self, x: Array) -> dict[str, Any]:
        return {**self.moved.designs.values(), **self.dimensions(x)}

    def free(self, most: int) -> Any:
        """Return the result of `least_squares`."""
        from scipy.optimize import least_squares

        count = len(self.values(self.goal.function, self.initial, GOAL))

        def residual(x: Array) -> Array:
            try:
                return self.values(self.goal.function, x, GOAL) / self.scale
            except AssemblyError:
                # least squares then tries a shorter step
                return np.full(count, np.inf)

        def derivative(x: Array) -> Array:
            return self.derivative(self.goal, x, GOAL) / self.scale

        jacobian: Any = derivative
        initial = np.clip(self.initial, START_MARGIN, 1.0 - START_MARGIN)
        tolerances: dict[str, Any] = dict.fromkeys(("xtol", "ftol", "gtol"), CONVERGENCE_TOLERANCE)
        return least_squares(residual, initial, jacobian, bounds=(0.0, 1.0), max_nfev=most, **tolerances)

    def constrained(self, most: int) -> Any:
        """Return the result of SLSQP."""
        from scipy.optimize import minimize

        def half_square_sum(x: Array) -> float:
            try:
                return 0.5 * float(np.square(self.values(self.goal.function, x, GOAL) / self.scale).sum())
            except AssemblyError:
                return GOAL_WITHOUT_ASSEMBLY

        def derivative(x: Array) -> Array:
            try:
                residual = self.values(self.goal.function, x, GOAL) / self.scale
                return residual @ self.derivative(self.goal, x, GOAL) / self.scale
            except AssemblyError:
                return np.zeros(len(x))

        def constraint(limit: Limit, sign: float, limit_value: float) -> dict[str, Any]:
            unit = _unit(limit)
            count = len(self.values(limit.function, self.initial, limit.name))

            def inside(x: Array) -> Array:
                try:
                    return sign * (self.values(limit.function, x, limit.name) - limit_value) / unit
                except AssemblyError:
                    return np.full(count, -1.0)

            def derivative(x: Array) -> Array:
                try:
                    return sign * self.derivative(limit, x, limit.name) / unit
                except AssemblyError:
                    return np.zeros((count, len(x)))

            return {"type": "ineq", "fun": inside, "jac": derivative}

        limits: Any = [constraint(*limit) for limit in bounded(self.limits)]
        jacobian: Any = derivative
        ends: Any = [(0.0, 1.0)] * len(self.names)
        options = {"maxiter": most, "ftol": CONVERGENCE_TOLERANCE}
        initial = np.clip(self.initial, 0.0, 1.0)
        return minimize(
            half_square_sum,
            initial,
            jac=jacobian,
            bounds=ends,
            constraints=limits,
            method="SLSQP",
            options=options,
        )

    def result(self, solution: Any) -> Optimum:
        """Return the result of a search."""
        x = np.clip(np.asarray(solution.x, dtype=np.float64), 0.0, 1.0)
        after = self.values(self.goal.function, x, GOAL)
        before = self.values(self.goal.function, self.initial, GOAL)
        closest: dict[str, float] = {}
        violated = False
        for limit, sign, limit_value in bounded(self.limits):
            inside = sign * (self.values(limit.function, x, limit.name) - limit_value)
            closest[limit.name] = float(limit_value + sign * inside.min())
            violated |= not inside.min() >= -LIMIT_TOLERANCE * _unit(limit)
        values = self.dimensions(x)
        outcome: SearchOutcome = (
            "limits missed" if violated else "found" if solution.success else "not converged"
        )
        return Optimum(
            moved=replace(self.moved, designs=family_at(self.moved.designs, values)),
            outcome=outcome,
            start=dict(zip(self.names, self.start.tolist(), strict=True)),
            values=values,
            before=float(np.sqrt(np.square(before).mean())),
            after=float(np.sqrt(np.square(after).mean())),
            limits=closest,
            at_bounds=tuple(
                name
                for name, position in zip(self.names, x, strict=True)
                if min(position, 1.0 - position) < BOUND_TOLERANCE
            ),
            tried=self.tried,
            message=str(solution.message),
        )


def _unit(limit: Limit) -> float:
    """Return the scale of a limit: its bounds, or 1 where they are zero."""
    return max(abs(limit.low or 0.0), abs(limit.high or 0.0)) or 1.0


def _ends(subject: MovedFamily, name: str, ends: tuple[float, float]) -> tuple[float, float]:
    """Return the bounds of a dimension after validation."""
    low, high = (float(end) for end in numbers(ends)) if np.shape(ends) == (2,) else (np.nan, np.nan)
    current = subject.designs.dimensions[name].value
    if not (-np.inf < low < high < np.inf):
        raise InputError(
            f"{name} may vary over {ends}; give its lowest and highest value in SI, in ascending order"
        )
    if not low <= current <= high:
        raise InputError(
            f"{name} is {current:g} initially, outside {low:g} to {high:g}; "
            "start inside the range, or widen it"
        )
    return low, high
