"""Effects of tolerances on a motion: worst case, root sum of squares, Monte Carlo, and the share of each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.model.motion import short_repr
from mechsim.model.progress import Progress, no_progress
from mechsim.numerics.arrays import Array
from mechsim.studies.sensitivity.monte_carlo import (
    MAX_SOLVED,
    MAX_VERIFIED,
    Advance,
    DesignSolver,
    Sampled,
    sample_tolerances,
)
from mechsim.studies.sensitivity.sensitivity import Sensitivity
from mechsim.studies.sensitivity.tolerances import CLEARANCE, Tolerances, parsed_tolerances

# default number of random samples: the standard deviation is known to 0.2 %; and their seed
SAMPLES, SEED = 100_000, 1


@dataclass(frozen=True)
class ToleranceStudy:
    """Effects of tolerances on quantities over a motion; all deviations are in SI.

    Attributes:
        table: the quantities and their derivatives by the dimensions that have tolerances.
        tolerances: of dimensions, and clearances of joints.
        contributions: dimension or JOINT.clearance -> deviations at its bound, to first order: one row for a
            dimension, one for each direction of a pin in its hole; quantity -> (n,) each.
        sampled: Monte Carlo statistics, all quantities one after the other; None without Monte Carlo.
    """

    table: Sensitivity
    tolerances: Tolerances
    contributions: Mapping[str, Sequence[Mapping[str, Array]]]
    sampled: Sampled | None

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
        spread = 1.0 / np.sqrt(len(rows) + 2.0) if len(rows) > 1 else self.tolerances.spread
        return spread**2 * self._squared(name, quantity)

    def random(self, quantity: str) -> dict[str, Array]:
        """Return Monte Carlo statistics of a quantity, (n,) each: mean, std, low, high, least, most."""
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
        """Yield the crank angle or the time, and each quantity with its deviations.

        Q, Q.worst, Q.rss, Q.deviation to first order, and of Monte Carlo Q.mean, Q.std, Q.low and Q.high
        (2.5 % and 97.5 % quantiles), Q.least and Q.most.
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
    progress: Progress = no_progress,
) -> ToleranceStudy:
    """Return the effects of tolerances on the quantities of a table.

    Args:
        table: quantities and their derivatives by every dimension with a tolerance.
        tolerances: dimension or JOINT.clearance -> bound, as text with a unit or in SI.
        samples: number of Monte Carlo samples; 0 leaves Monte Carlo out.
        seed: of its random numbers.
        progress: called with a text and the finished fraction.

    Raises:
        InputError: for an unknown name, or tolerances that allow no assembly.
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
    monte_carlo = None
    if samples:
        width = len(table) * len(columns)
        derivative = np.array([_row(row, columns) for (row,) in contributions.values()]).reshape(
            len(contributions), width
        )
        values = np.concatenate([table.values[column] for column in columns])
        angular = np.repeat([table.units[column] == "rad" for column in columns], len(table))
        solved = DesignSolver(moved, columns, requested.bounds, values, angular)
        loose = [np.array([_row(row, columns) for row in own]) for own in plays.values()]
        advance = _counted(progress, MAX_VERIFIED + MAX_SOLVED)
        monte_carlo = sample_tolerances(solved, derivative, loose, requested, samples, seed, advance)
    contributions |= {joint + CLEARANCE: own for joint, own in plays.items()}
    return ToleranceStudy(table, requested, contributions, monte_carlo)


def _row(deviations: Mapping[str, Array], columns: Sequence[str]) -> Array:
    return np.concatenate([deviations[name] for name in columns])


def _counted(progress: Progress, total: int) -> Advance:
    count = 0

    def advance() -> None:
        nonlocal count
        count += 1
        progress(f"{count} of {total} mechanisms", min(1.0, count / total))

    return advance
