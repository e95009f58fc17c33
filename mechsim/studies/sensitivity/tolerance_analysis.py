"""Effects of tolerances on a motion: worst case, root sum of squares, and the share of each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.mechanism.motion import short_repr
from mechsim.numerics.arrays import Array
from mechsim.studies.sensitivity.sensitivity import Sensitivity
from mechsim.studies.sensitivity.tolerances import CLEARANCE, Tolerances, parsed_tolerances

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
    requested = (
        tolerances
        if isinstance(tolerances, Tolerances)
        else parsed_tolerances(
            tolerances, moved.designs.dimensions, moved.solver.mechanism, declared=moved.solver.written
        )
    )
    columns = list(table.values)
    moved.designs.require_independent(requested.bounds)
    by = {name: table.by[name] for name in requested.bounds if name in table.by}
    if missing := [name for name in requested.bounds if name not in by]:
        by |= moved.derivatives(columns, missing).by
    contributions: dict[str, list[dict[str, Array]]] = {
        name: [{column: by[name][column] * tolerance for column in columns}]
        for name, tolerance in requested.bounds.items()
    }
    plays = {
        joint: [{column: radius * own[column] for column in columns} for own in moved.play(columns, joint)]
        for joint, radius in requested.clearances.items()
    }
    contributions |= {joint + CLEARANCE: own for joint, own in plays.items()}
    return ToleranceStudy(table, requested, contributions)
