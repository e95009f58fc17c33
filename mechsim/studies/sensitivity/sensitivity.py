"""Derivatives of quantities by dimensions over a motion as one table, and effects of tolerances on them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.errors import AssemblyError, InputError, needs
from mechsim.io.readers import parametric_model
from mechsim.io.toml_values import suggestion
from mechsim.kinematics.designs import Dimension
from mechsim.kinematics.path_instants import path_instants
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.forces import Forces
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import short_repr
from mechsim.mechanism.quantity import AXES
from mechsim.numerics.arrays import Array, numbers
from mechsim.studies.sensitivity.moved_family import (
    MovedFamily,
    QuantityDerivatives,
    spread_instants,
)
from mechsim.studies.sensitivity.tolerances import CLEARANCE, Tolerances, parsed_tolerances

if TYPE_CHECKING:
    from pandas import DataFrame

# selects every dimension
ALL = "all"


@dataclass(frozen=True)
class Sensitivity:
    """Quantities of a mechanism and their derivatives by dimensions, over a motion.

    Attributes:
        moved: the mechanism and its driver motion.
        values: quantity -> (n,), in SI.
        by: dimension -> quantity -> derivative at fixed driver positions, (n,), in SI per SI unit.
        units: quantity -> its SI unit.
        left_out: dimension -> reason why it has no derivative, for dimensions selected by "all" only.
    """

    moved: MovedFamily
    values: Mapping[str, Array]
    by: Mapping[str, Mapping[str, Array]]
    units: Mapping[str, str]
    left_out: Mapping[str, str]

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.moved.angles)

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.moved.designs.name

    @property
    def dimensions(self) -> dict[str, Dimension]:
        """The dimensions, by name."""
        return {name: self.moved.designs.dimensions[name] for name in self.by}

    def derivatives(self, quantity: str) -> dict[str, Array]:
        """Return the derivatives of a quantity: dimension -> (n,)."""
        return {name: own[quantity] for name, own in self.by.items()}

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield the crank angle or the time, the quantities, and the derivatives as QUANTITY/DIMENSION."""
        yield self.moved.over
        for quantity in self.values:
            for name, values in self.derivatives(quantity).items():
                yield f"{quantity}/{name}", values

    def unit(self, quantity: str, dimension: str) -> str:
        """Return the unit of a derivative."""
        return per(self.units[quantity], self.dimensions[dimension].unit)

    def to_pandas(self) -> DataFrame:
        """Return the columns as a table with one row for each instant.

        Raises:
            MissingToolError: if pandas is not installed.
        """
        with needs("tables"):
            from pandas import DataFrame as PandasDataFrame
        return PandasDataFrame(dict(self.columns()))


def per(unit: str, by: str) -> str:
    """Return the unit of a derivative."""
    if unit == by:
        return "1"
    return unit if by == "1" else f"{unit}/{by}"


def dimension_names(moved: MovedFamily, to: str | Sequence[str]) -> list[str]:
    """Return names of dimensions; a position stands for its components, and "all" for every dimension.

    Raises:
        InputError: for an unknown dimension.
    """
    dimensions = moved.designs.dimensions
    if to == ALL or list(to) == [ALL]:
        return list(moved.designs.usual or dimensions)
    names: dict[str, None] = {}
    for name in (to,) if isinstance(to, str) else to:
        components = [f"{name}.{axis}" for axis in AXES if f"{name}.{axis}" in dimensions]
        if name not in dimensions and not components:
            shown = moved.designs.usual or dimensions
            raise InputError(f"{moved.designs.name} has no dimension {name!r}{suggestion(name, shown)}")
        names |= dict.fromkeys([name] if name in dimensions else components)
    return list(names)


def derivative_table(
    moved: MovedFamily, quantities: Sequence[str], to: str | Sequence[str] = ALL
) -> Sensitivity:
    """Return quantities of a mechanism and their exact derivatives by dimensions.

    Args:
        moved: the mechanism and its driver motion.
        quantities: names as in `model.quantities`.
        to: dimensions; "all" leaves out those that cannot change alone.

    Raises:
        InputError: for an unknown quantity or dimension.
        AssemblyError: for loops that do not close, or a motion through a change point.
    """
    columns, names = moved.quantities(quantities), dimension_names(moved, to)
    left_out: dict[str, str] = {}
    try:
        result = moved.derivatives(columns, names)
    except AssemblyError:
        if to != ALL and list(to) != [ALL]:
            raise
        result = moved.derivatives(columns, [])
        for name in names:
            try:
                single = moved.derivatives(columns, [name])
            except AssemblyError as error:
                left_out[name] = str(error)
                continue
            result = QuantityDerivatives(result.values, {**result.by, **single.by})
    units = {name: moved.quantity(name).unit for name in columns}
    return Sensitivity(moved, result.values, result.by, units, left_out)


Subject = str | KinematicSolver | Mechanism | MovedFamily


def moved(
    model: Subject,
    *,
    angles: ArrayLike | None = None,
    t: ArrayLike | None = None,
    speed: float | str = 1.0,
    forces: Forces | None = None,
) -> MovedFamily:
    """Return a parametric model and its driver motion.

    Args:
        model: as for `load`, or a solver.
        angles: crank angles, (n,) in [rad] or text, as "0:360:5deg". Without angles and times, instants are
            spread over the crank's range, or over the duration of motion laws.
        t: times, (n,) in [s], of motion laws, or of a crank that turns at `speed`.
        speed: crank speed in [rad/s] or text, as "600rpm"; motion laws have their own.
        forces: applied forces; None takes those of the file.

    Raises:
        InputError: as for `load`, for angles or times that are not finite, and for angles under motion laws.
    """
    if isinstance(model, MovedFamily):
        return model
    crank_speed = units.si(speed, "rad/s", "the speed")
    designs = parametric_model(model)
    solver = designs.make({})
    if angles is None and t is None:
        return MovedFamily(designs, spread_instants(solver), crank_speed, forces)
    path_speed = crank_speed if solver.motion_laws.crank else None
    parameter = np.atleast_1d(
        numbers(path_instants(solver.mechanism, solver.motion_laws, angles, path_speed, 0.0, t).parameter)
    )
    if parameter.ndim != 1 or not parameter.size or not np.isfinite(parameter).all():
        raise InputError(f"{designs.name}: angles must be a list of finite numbers; give them in [rad]")
    return MovedFamily(designs, parameter, crank_speed, forces)


def sensitivity(
    model: Subject,
    quantities: str | Sequence[str],
    to: str | Sequence[str] = ALL,
    *,
    angles: ArrayLike | None = None,
    t: ArrayLike | None = None,
    speed: float | str = 1.0,
    forces: Forces | None = None,
) -> Sensitivity:
    """Return quantities of a model and their exact derivatives by dimensions, at fixed driver positions.

    Args:
        model: as for `moved`.
        quantities: points (P3, P3.v), joints (rocker), columns (P3.x, rocker.v, torque, P3.fx), force:P3,
            distance:P2,P3 and others of `model.quantities`.
        to: dimensions: parameters, components of positions, as pivot.x; of a mechanism without parameters
            JOINT.at.x; "all" selects every dimension.
        angles: as for `moved`.
        t: as for `moved`.
        speed: as for `moved`.
        forces: as for `moved`.

    Raises:
        InputError: for an unknown quantity or dimension, with the closest known one.
        AssemblyError: for loops that do not close, or a motion through a change point.

    Accuracy: about 1e-15 times the condition of the loops; docs/explanation/accuracy.md has the measurements.
    """
    subject = moved(model, angles=angles, t=t, speed=speed, forces=forces)
    return derivative_table(subject, [quantities] if isinstance(quantities, str) else quantities, to)


# standard deviation of a dimension relative to its bound, for a uniform distribution
SPREAD = 1.0 / np.sqrt(3.0)


@dataclass(frozen=True)
class ToleranceStudy:
    """Effects of tolerances on quantities over a motion; all deviations are in SI.

    Attributes:
        table: the quantities and their derivatives by the dimensions that have tolerances.
        tolerances: of dimensions, and clearances of joints.
        contributions: dimension or JOINT.clearance -> deviations at its bound, to first order: one row for a
            dimension, one for each direction of a pin in its hole; quantity -> (n,) each.
    """

    table: Sensitivity
    tolerances: Tolerances
    contributions: Mapping[str, Sequence[Mapping[str, Array]]]

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.table)

    def worst(self, quantity: str) -> Array:
        """Return the worst-case deviation of a quantity, to first order, (n,)."""
        return np.sum([np.sqrt(self._squared(name, quantity)) for name in self.contributions], 0)

    def squares(self, quantity: str) -> Array:
        """Return the root sum of squares of all contributions, (n,)."""
        return np.sqrt(np.sum([self._squared(name, quantity) for name in self.contributions], 0))

    def deviation(self, quantity: str) -> Array:
        """Return the standard deviation of a quantity to first order, (n,)."""
        return np.sqrt(np.sum([self._variance(name, quantity) for name in self.contributions], 0))

    def shares(self, quantity: str) -> dict[str, float]:
        """Return the fraction of a quantity's variance from each tolerance; their sum is 1."""
        variances = {name: float(self._variance(name, quantity).sum()) for name in self.contributions}
        total = sum(variances.values())
        return {name: variance / total if total > 0.0 else 0.0 for name, variance in variances.items()}

    def _squared(self, name: str, quantity: str) -> Array:
        return np.sum([row[quantity] ** 2 for row in self.contributions[name]], 0)

    def _variance(self, name: str, quantity: str) -> Array:
        rows = self.contributions[name]
        # fraction of the variance in one direction, for a pin uniform in a disc or a ball
        spread = 1.0 / np.sqrt(len(rows) + 2.0) if len(rows) > 1 else SPREAD
        return spread**2 * self._squared(name, quantity)

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield the crank angle or the time, and each quantity with its deviations.

        Q, and to first order Q.worst, Q.rss and Q.deviation.
        """
        yield self.table.moved.over
        for quantity, values in self.table.values.items():
            yield quantity, values
            yield f"{quantity}.worst", self.worst(quantity)
            yield f"{quantity}.rss", self.squares(quantity)
            yield f"{quantity}.deviation", self.deviation(quantity)


def tolerance_study(table: Sensitivity, tolerances: Mapping[str, str | float] | Tolerances) -> ToleranceStudy:
    """Return the effects of tolerances on the quantities of a table.

    Args:
        table: quantities and their derivatives by every dimension with a tolerance.
        tolerances: dimension or JOINT.clearance -> bound, as text with a unit or in SI.

    Raises:
        InputError: for an unknown name.
        AssemblyError: for a clearance that opens redundant loops.
    """
    moved = table.moved
    requested, solver = tolerances, moved.solver
    if not isinstance(requested, Tolerances):
        dimensions = moved.designs.dimensions
        requested = parsed_tolerances(requested, dimensions, solver.mechanism, declared=solver.written)
    columns = list(table.values)
    moved.designs.require_independent(requested.bounds)
    by = {name: table.by[name] for name in requested.bounds if name in table.by}
    if missing := [name for name in requested.bounds if name not in by]:
        by |= moved.derivatives(columns, missing).by
    contributions: dict[str, list[dict[str, Array]]] = {
        name: [{column: by[name][column] * tolerance for column in columns}]
        for name, tolerance in requested.bounds.items()
    }
    for joint, radius in requested.clearances.items():
        plays = moved.play(columns, joint)
        contributions[joint + CLEARANCE] = [{name: radius * own[name] for name in columns} for own in plays]
    return ToleranceStudy(table, requested, contributions)
