"""What tolerances make of a motion: worst case, root of squares, Monte Carlo, and the share of each."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.model.motion import short_repr
from mechsim.numerics.arrays import Array, tangents
from mechsim.studies.sensitivity.monte_carlo import (
    CHECKED,
    Advance,
    Sampled,
    Solved,
    sample_tolerances,
    solves,
)
from mechsim.studies.sensitivity.sensitivity import Sensitivity
from mechsim.studies.sensitivity.tolerances import CLEARANCE, Tolerances, parsed_tolerances

SAMPLES, SEED = 100_000, 1


@dataclass(frozen=True)
class ToleranceStudy:
    """What tolerances make of quantities over a motion; all that is off is in SI.

    Attributes:
        table: the quantities and their derivatives by the dimensions that have tolerances.
        tolerances: of dimensions, and clearances of joints.
        offs: dimension or JOINT.clearance -> what it puts quantities off by at its bound, to first order: one
            row of a dimension, one for each direction of a pin in its hole; by quantity, (n,) each.
        sampled: of Monte Carlo, all quantities one after the other; None where it was left out.
    """

    table: Sensitivity
    tolerances: Tolerances
    offs: Mapping[str, Sequence[Mapping[str, Array]]]
    sampled: Sampled | None

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.table)

    def worst(self, quantity: str) -> Array:
        """Return by how much a quantity is off where all conspire, to first order, (n,)."""
        return np.sum([np.sqrt(self._squared(name, quantity)) for name in self.offs], 0)

    def squares(self, quantity: str) -> Array:
        """Return the root of the sum of squares of what each puts off at most, (n,)."""
        return np.sqrt(np.sum([self._squared(name, quantity) for name in self.offs], 0))

    def deviation(self, quantity: str) -> Array:
        """Return the standard deviation of a quantity to first order, (n,)."""
        return np.sqrt(np.sum([self._variance(name, quantity) for name in self.offs], 0))

    def shares(self, quantity: str) -> dict[str, float]:
        """Return the part of a quantity's variance that each makes, over the motion; they add up to 1."""
        variances = {name: float(self._variance(name, quantity).sum()) for name in self.offs}
        total = sum(variances.values())
        return {name: variance / total if total > 0.0 else 0.0 for name, variance in variances.items()}

    def across(self, quantities: Sequence[str], direction: Array) -> list[Array]:
        """Return by how much each puts some quantities off at most along a direction, (n,) each.

        Args:
            quantities: k of them, as the coordinates of a point.
            direction: unit vectors, (n, k).
        """

        def along(row: Mapping[str, Array]) -> Array:
            return (direction * np.column_stack([row[name] for name in quantities])).sum(1)

        return [np.sqrt(np.sum([along(row) ** 2 for row in own], 0)) for own in self.offs.values()]

    def _squared(self, name: str, quantity: str) -> Array:
        return np.sum([row[quantity] ** 2 for row in self.offs[name]], 0)

    def _variance(self, name: str, quantity: str) -> Array:
        rows = self.offs[name]
        # one direction's part of the variance of a pin anywhere in a disc or a ball
        spread = 1.0 / np.sqrt(len(rows) + 2.0) if len(rows) > 1 else self.tolerances.spread
        return spread**2 * self._squared(name, quantity)

    def random(self, quantity: str) -> dict[str, Array]:
        """Return what Monte Carlo says of a quantity, (n,) each: mean, std, low, high, least, most."""
        if self.sampled is None:
            return {}
        index = list(self.table.values).index(quantity)
        rows = slice(index * len(self), (index + 1) * len(self))
        names = {
            "mean": "mean",
            "std": "deviation",
            "low": "low",
            "high": "high",
            "least": "least",
            "most": "most",
        }
        return {name: getattr(self.sampled, field)[rows] for name, field in names.items()}

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield the crank angle or the time, and of each quantity itself and by how much it is off.

        Q, Q.worst, Q.rss, Q.deviation to first order, and of Monte Carlo Q.mean, Q.std, Q.low, Q.high (2.5 %
        lie beyond either), Q.least and Q.most.
        """
        yield self.table.moved.over
        for quantity, values in self.table.values.items():
            yield quantity, values
            yield f"{quantity}.worst", self.worst(quantity)
            yield f"{quantity}.rss", self.squares(quantity)
            yield f"{quantity}.deviation", self.deviation(quantity)
            for name, statistic in self.random(quantity).items():
                yield f"{quantity}.{name}", statistic


def tolerance_study(
    table: Sensitivity,
    tolerances: Mapping[str, str | float] | Tolerances,
    *,
    samples: int = SAMPLES,
    seed: int = SEED,
    progress: Callable[[str, float], None] = lambda _, __: None,
) -> ToleranceStudy:
    """Return what tolerances make of the quantities of a table.

    Args:
        table: quantities and derivatives by every dimension that has a tolerance.
        tolerances: dimension or JOINT.clearance -> bound, as text with a unit or in SI.
        samples: of Monte Carlo; 0 leaves it out.
        seed: of its random numbers.
        progress: called with a text and the finished fraction.

    Raises:
        InputError: for a name that is none, or tolerances that leave no assembly.
        AssemblyError: where a clearance would tear loops open that repeat each other.
    """
    moved = table.moved
    requested = (
        tolerances
        if isinstance(tolerances, Tolerances)
        else parsed_tolerances(tolerances, moved.designs.dimensions, moved.solver.mechanism)
    )
    columns = list(table.values)
    moved.designs.require_independent(requested.bounds)
    by = {name: table.by[name] for name in requested.bounds if name in table.by}
    if missing := [name for name in requested.bounds if name not in by]:
        by |= moved.derivatives(columns, missing).by
    offs: dict[str, list[dict[str, Array]]] = {
        name: [{column: by[name][column] * tolerance for column in columns}]
        for name, tolerance in requested.bounds.items()
    }
    plays = {
        joint: [{column: radius * own[column] for column in columns} for own in moved.play(columns, joint)]
        for joint, radius in requested.clearances.items()
    }
    monte_carlo = None
    if samples:
        width = len(table) * len(columns)
        derivative = np.array([_row(row, columns) for (row,) in offs.values()]).reshape(len(offs), width)
        values = np.concatenate([table.values[column] for column in columns])
        angular = np.repeat([table.units[column] == "rad" for column in columns], len(table))
        solved = Solved(moved, columns, requested.bounds, values, angular)
        loose = [np.array([_row(row, columns) for row in own]) for own in plays.values()]
        advance = _counted(progress, CHECKED + (solves(len(derivative)) if len(derivative) else 0))
        monte_carlo = sample_tolerances(solved, derivative, loose, requested, samples, seed, advance)
    offs |= {joint + CLEARANCE: own for joint, own in plays.items()}
    return ToleranceStudy(table, requested, offs, monte_carlo)


def _row(off: Mapping[str, Array], columns: Sequence[str]) -> Array:
    return np.concatenate([off[name] for name in columns])


def _counted(progress: Callable[[str, float], None], total: int) -> Advance:
    count = 0

    def advance() -> None:
        nonlocal count
        count += 1
        progress(f"{count} of {total} mechanisms", min(1.0, count / total))

    return advance


@dataclass(frozen=True, slots=True)
class PathDeviation:
    """A path, and how far aside of it a point can lie: across the path in the plane nearest to it.

    Attributes:
        point: its name.
        positions: (n, 3) in [m].
        worst: where all conspire, to first order, (n,) in [m].
        squares: by the root of the sum of squares, (n,) in [m].
    """

    point: str
    positions: Array
    worst: Array
    squares: Array


def path_bands(table: Sensitivity, study: ToleranceStudy) -> list[PathDeviation]:
    """Return the bands of the points whose three coordinates are in a study and that move."""
    bands: list[PathDeviation] = []
    for point in table.moved.solver.mechanism.points:
        columns = [f"{point}.{axis}" for axis in "xyz"]
        if not all(column in table.values for column in columns):
            continue
        positions = np.column_stack([table.values[column] for column in columns])
        if np.ptp(positions, axis=0).max() == 0.0:
            continue
        deviations = study.across(columns, _across(positions))
        total, squares = np.sum(deviations, 0), np.sqrt(np.sum(np.square(deviations), 0))
        bands.append(PathDeviation(point, positions, total, squares))
    return bands


def _across(positions: Array) -> Array:
    """Return unit vectors across a path in the plane nearest to it, (n, 3)."""
    middle = positions - positions.mean(0)
    normal = np.linalg.svd(middle, full_matrices=False)[2][2]
    across = np.cross(normal, tangents(middle))
    length = np.sqrt((across**2).sum(1, keepdims=True))
    return across / np.where(length > 0.0, length, 1.0)
