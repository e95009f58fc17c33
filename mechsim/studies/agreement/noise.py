"""Measured values compared with an exact motion: noise of known standard deviation, or a systematic error.

The residuals, divided by the stated standard deviations, are independent standard normal numbers if the model
is right. Three statistics are tested: the sum of squares (chi squared), the sum of squares of the smooth part
(the projection on a constant and half waves over the driver, chi squared as well), and the largest residual.
A systematic error within the tolerance of exact values is allowed in each, by the triangle inequality.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from mechsim.numerics.arrays import Array

# probability that a correct table fails, over all its columns and tests
FALSE_ALARM = 1e-3
TESTS = 3
# number of basis functions of the smooth part: a constant, and half waves up to four waves; at most half
# the number of rows
SMOOTH_FUNCTIONS = 9
# number of standard deviations below which the report calls the stated noise too large
LOW_DEVIATION = 0.7


def special() -> Any:
    """Return scipy's special functions, which load slowly."""
    from scipy import special as functions

    return functions


@dataclass(frozen=True, slots=True, kw_only=True)
class Statistic:
    """One statistic of the residuals.

    Attributes:
        what: the statistic in words.
        squares: sum of squared residuals, in squared standard deviations.
        degrees: its degrees of freedom.
        probability: of this value or a larger one if the model is right.
        worst: the statistic as a residual in standard deviations: root mean square, or the largest.
        limit: the largest value of `worst` that passes.
    """

    JSON: ClassVar[tuple[str, ...]] = ("squares", "degrees", "probability", "worst", "limit", "passed")

    what: str
    squares: float
    degrees: int
    probability: float
    worst: float
    limit: float

    @property
    def passed(self) -> bool:
        """Whether noise explains the statistic; NaN fails."""
        return self.worst <= self.limit

    @property
    def used(self) -> float:
        """The statistic relative to its limit."""
        return self.worst / self.limit


@dataclass(frozen=True, slots=True, kw_only=True)
class Noise:
    """Tests of the residuals of one measured quantity for systematic errors.

    Attributes:
        total: chi squared of all residuals.
        smooth: chi squared of their smooth part.
        largest: the largest residual.
        row: index of the largest residual, from 0.
        deviation: root mean square of the stated standard deviations, in the unit of the quantity.
    """

    JSON: ClassVar[tuple[str, ...]] = (
        "passed",
        "sigma",
        "deviation",
        "chi_squared=total",
        "smooth",
        "largest",
    )

    total: Statistic
    smooth: Statistic
    largest: Statistic
    row: int
    deviation: float

    @property
    def passed(self) -> bool:
        """Whether noise explains all residuals."""
        return all(statistic.passed for statistic in self.statistics)

    @property
    def statistics(self) -> tuple[Statistic, Statistic, Statistic]:
        """All statistics."""
        return self.total, self.smooth, self.largest

    @property
    def decisive(self) -> Statistic:
        """The statistic with the largest ratio to its limit."""
        return max(self.statistics, key=lambda statistic: statistic.used)

    @property
    def reason(self) -> str:
        """The decisive statistic in words, as the reason of a check."""
        statistic = self.decisive
        return (
            f"{statistic.what}, {statistic.worst:.3g} of {statistic.limit:.3g} standard deviations of "
            f"{self.deviation:.3g}; "
            f"probability {probable(statistic.probability)}"
        )

    @property
    def sigma(self) -> float:
        """Root mean square of all residuals in standard deviations."""
        return self.total.worst


def noise_of(error: Array, deviation: Array, phase: Array, *, allowed: float, quantities: int) -> Noise:
    """Test whether errors are noise of known standard deviation.

    Args:
        error: measured minus exact, (n, k).
        deviation: standard deviation of each, above 0, (n, k).
        phase: angle of the crank within its period, or the parameter of the motion laws, (n,); a systematic
            error is smooth over it.
        allowed: systematic error that is within the tolerance, in the unit of `error`.
            quantities: number of quantities of the table that are tested; they share `FALSE_ALARM`.
    """
    residual = error / deviation
    systematic = allowed / deviation
    tail = FALSE_ALARM / (TESTS * quantities)
    basis = _smooth_basis(len(residual))
    smooth = basis.T @ residual[np.argsort(phase, kind="stable")]
    shift = float(np.sqrt((systematic**2).sum()))
    row = int(np.argmax(np.abs(residual).max(1)))
    return Noise(
        total=_chi_squared("root mean square of the errors", residual, shift, tail),
        smooth=_chi_squared("smooth part of the errors", smooth, shift, tail),
        largest=_largest(residual, float(systematic.max()), tail),
        row=row,
        deviation=float(np.sqrt(np.mean(deviation**2))),
    )


def _smooth_basis(rows: int) -> Array:
    """Return the orthonormal cosines of lowest order over the rows, (n, m)."""
    orders = np.arange(min(SMOOTH_FUNCTIONS, max(1, rows // 2)))
    basis = np.cos(np.pi * np.outer(np.arange(rows) + 0.5, orders) / rows)
    return basis / np.sqrt((basis**2).sum(0))


def _chi_squared(what: str, values: Array, shift: float, tail: float) -> Statistic:
    """Return the test of a sum of squares; `shift` is the norm of an allowed error."""
    degrees, norm = values.size, float(np.sqrt((values**2).sum()))
    beyond = max(0.0, norm - shift) if norm == norm else np.inf
    limit = float(np.sqrt(2.0 * special().gammainccinv(degrees / 2.0, tail))) + shift
    root = np.sqrt(degrees)
    return Statistic(
        what=what,
        squares=norm**2,
        degrees=degrees,
        probability=float(special().gammaincc(degrees / 2.0, beyond**2 / 2.0)),
        worst=float(norm / root),
        limit=float(limit / root),
    )


def _largest(residual: Array, shift: float, tail: float) -> Statistic:
    """Return the test of the largest of many standard normal numbers."""
    count, worst = residual.size, float(np.abs(residual).max())
    # 1 - (1 - p)^count, accurate for small p
    each = -np.expm1(np.log1p(-tail) / count)
    beyond = max(0.0, worst - shift)
    outside = 2.0 * float(special().ndtr(-beyond))
    return Statistic(
        what="largest error",
        squares=worst**2,
        degrees=count,
        probability=1.0 if outside >= 1.0 else float(-np.expm1(count * np.log1p(-outside))),
        worst=worst,
        limit=float(-special().ndtri(each / 2.0)) + shift,
    )


def noise_report(tested: Sequence[tuple[str, Noise]]) -> str:
    """Return the joint result of all measured quantities in one sentence; empty without any.

    Args:
        tested: quantity -> its tests.
    """
    if not tested:
        return ""
    squares, degrees, probability = totals([noise for _, noise in tested], "total")
    sigma = float(np.sqrt(squares / degrees))
    counts = (
        f"chi squared {squares:.4g} with {degrees} degrees of freedom, probability {probable(probability)}"
    )
    failed = [(name, noise) for name, noise in tested if not noise.passed]
    if failed:
        name, worst = max(failed, key=lambda pair: pair[1].decisive.used)
        return f"errors of {sigma:.2g} sigma, not noise alone ({counts}); {_what(name, worst)}"
    waves, number, chance = totals([noise for _, noise in tested], "smooth")
    stated = " (less than stated)" if sigma < LOW_DEVIATION and degrees > 10 else ""
    return (
        f"noise of {sigma:.2g} sigma{stated}, nothing systematic ({counts}; "
        f"smooth part {waves:.3g} with {number}, probability {probable(chance)})"
    )


def noise_data(tested: Sequence[tuple[str, Noise]]) -> dict[str, Any]:
    """Return the joint result of all measured quantities, and the tests of each, as plain data."""
    squares, degrees, probability = totals([noise for _, noise in tested], "total")
    return {
        "sigma": float(np.sqrt(squares / degrees)),
        "systematic": not all(noise.passed for _, noise in tested),
        "chi_squared": squares,
        "degrees": degrees,
        "probability": probability,
        "false_alarm": FALSE_ALARM,
        "report": noise_report(tested),
        "quantities": dict(tested),
    }


def totals(tested: Sequence[Noise], which: str) -> tuple[float, int, float]:
    """Return the sum of squares of one statistic over quantities, its degrees of freedom and probability."""
    statistics: list[Statistic] = [getattr(statistic, which) for statistic in tested]
    squares, degrees = (
        sum(statistic.squares for statistic in statistics),
        sum(statistic.degrees for statistic in statistics),
    )
    return squares, degrees, float(special().gammaincc(degrees / 2.0, squares / 2.0))


def _what(name: str, noise: Noise) -> str:
    statistic = noise.decisive
    if statistic is noise.largest:
        row = f"row {noise.row + 1} of {name}"
        return f"{row} is {statistic.worst:.3g} sigma off, noise reaches {statistic.limit:.3g}"
    return (
        f"the {statistic.what} in {name} is {statistic.worst:.3g} sigma, noise reaches {statistic.limit:.3g}"
    )


def probable(value: float) -> str:
    """Return a probability as a short text."""
    return f"{value:.2f}" if value >= 0.01 else f"{value:.0e}" if value >= 1e-12 else "below 1e-12"
