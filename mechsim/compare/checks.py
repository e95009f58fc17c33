"""Checks of quantities against their tolerances, and the resulting verdict."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any, ClassVar

import numpy as np

from mechsim.compare.quantities import QUANTITIES, ComparedQuantity
from mechsim.compare.tolerances import (
    InstantUnit,
    RecordInstants,
    Requested,
    Tolerance,
    instant_text,
    instants_of,
)
from mechsim.errors import first_names
from mechsim.mechanism.finding import Outcome, most_severe
from mechsim.numerics.arrays import Array

Tolerances = Mapping[str, Tolerance]


# most lines of a `repr`
REPR_LINES = 8


def first_lines(self: Any) -> str:
    """Return the first lines of `str(self)`; used as `__repr__` of results with many checks."""
    lines = str(self).splitlines()
    more = len(lines) - REPR_LINES + 1
    return "\n".join(
        lines if more <= 1 else [*lines[: REPR_LINES - 1], f"  and {more} more; print lists all"]
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One quantity of a verdict.

    Attributes:
        kind: compared quantity, a name in `QUANTITIES` or other words.
        subject: point, link or joint; empty for the whole record.
        method: "pose", "step" or another; empty if the verdict covers only one method.
        variant: variant of the mechanism; empty if there is only one.
        unit: unit of worst, rms and tolerance.
        worst: error at the instant where it is the largest fraction of its tolerance.
        instant: crank angle of the worst error in [rad], or time in [s] under motion laws; see `at_unit`.
        at_unit: "rad", "s", or "row" of a table without times.
        rms: root mean square of the error over the run.
        tolerance: largest allowed error at that instant.
        reason: reason of the tolerance.
    """

    # what JSON contains
    JSON: ClassVar[tuple[str, ...]] = (
        *("quantity", "method", "unit", "worst", "at=instant", "at_unit", "rms", "tolerance"),
        *("reason", "passed"),
    )

    kind: str
    subject: str = ""
    method: str = ""
    variant: str = ""
    unit: str
    worst: float
    instant: float
    at_unit: InstantUnit = "rad"
    rms: float
    tolerance: float
    reason: str

    @property
    def quantity(self) -> str:
        """Quantity and subject in words, after the variant if there is one."""
        return f"{self.variant}, {self._name}" if self.variant else self._name

    @property
    def title(self) -> str:
        """Variant, method, quantity and subject in words."""
        label = ", ".join(filter(None, (self.variant, self.method)))
        return f"{label}: {self._name}" if self.method else self.quantity

    @property
    def _name(self) -> str:
        row = QUANTITIES.get(self.kind)
        return row.label(self.subject) if row else self.kind

    @property
    def passed(self) -> bool:
        """Whether the worst error is within the tolerance; NaN is not."""
        return self.worst <= self.tolerance

    @property
    def fraction_of_tolerance(self) -> float | None:
        """The worst error divided by its tolerance; None if this is not a number."""
        return self.worst / self.tolerance if np.isfinite(self.worst) and self.tolerance > 0.0 else None

    @property
    def severity(self) -> float:
        """The same as a rank: infinite for an error that is not a number, or above a tolerance of 0."""
        fraction = self.fraction_of_tolerance
        return fraction if fraction is not None else 0.0 if self.passed else np.inf

    @property
    def columns(self) -> tuple[str, str, str, str, str, str, str]:
        """The check as a row of `check_table`, with angles in degrees."""
        worst = f"{self.worst:.2e}" if self.worst else "0"
        instant = float(np.rad2deg(self.instant)) if self.at_unit == "rad" else self.instant
        numbers = worst, f"{instant:.4g}", f"{self.tolerance:.1e}"
        return self.title, *numbers, self.unit, "PASS" if self.passed else "FAIL", self.reason

    def __str__(self) -> str:
        relation = "<=" if self.passed else "> " if self.worst == self.worst else "? "
        return (
            f"{self.title:<34} {self.worst:9.2e} {relation} {self.tolerance:8.1e} {self.unit:<6} "
            f"at {self.instant:7.4f} {self.at_unit}  ({self.reason})"
        )


@dataclass(frozen=True, slots=True)
class Verdict:
    """The result of a comparison; print it to see the table.

    Attributes:
        outcome: one of "passed", "failed", "diverged", "changed assembly", "cannot assemble".
        checks: the checks of all quantities.
        reason: one sentence if the outcome is not "passed".
    """

    JSON: ClassVar[tuple[str, ...]] = ("passed", "outcome", "reason", "checks")

    outcome: Outcome
    checks: tuple[Check, ...]
    reason: str = ""

    @property
    def passed(self) -> bool:
        """Whether every quantity is within its tolerance."""
        return self.outcome == "passed"

    def __str__(self) -> str:
        head = self.outcome if not self.reason else f"{self.outcome}: {self.reason}"
        return "\n".join([head, *(f"  {check}" for check in self.checks)])

    __repr__ = first_lines


def check_table(checks: Sequence[Check]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the heading and the rows of a table of checks."""
    at_units = [check.at_unit.replace("rad", "deg") for check in checks]
    units = sorted({*at_units})
    heading = f"at [{units[0]}]" if len(units) == 1 else "at"
    rows: list[tuple[str, ...]] = []
    for check, unit in zip(checks, at_units, strict=True):
        quantity, worst, instant, *rest = check.columns
        rows.append((quantity, worst, instant if len(units) == 1 else f"{instant} {unit}", *rest))
    return ("quantity", "worst", heading, "tolerance", "unit", "", "reason"), rows


def tolerances_of(
    rows: Iterable[ComparedQuantity], method: str, scales: Mapping[str, float], requested: Requested
) -> dict[str, Tolerance]:
    """Return the tolerances of quantities for a method, without those that it does not compute."""
    rules = [(row, row.bounds[method]) for row in rows if method in row.bounds]
    return {
        row.name: rule.tolerance(row.unit, scales[rule.scale or row.scale], requested) for row, rule in rules
    }


def checks_of(
    rows: Iterable[ComparedQuantity],
    computed: Any,
    exact: Any,
    allowed: Tolerances,
    conditioning: Array | None = None,
) -> Iterator[Check]:
    """Compare two records: each quantity for each of its subjects.

    Args:
        rows: the quantities.
        computed: the record to check.
        exact: the reference record.
        allowed: tolerances by quantity.
        conditioning: conditioning of the loops at each instant, (n,), which widens tolerances; None if
            unknown.
    """
    instants = instants_of(computed)
    for over, group in groupby(rows, lambda row: row.over):
        among = tuple(group)
        for subject in over(computed, exact):
            for row in among:
                error = row.error(computed, exact, subject)
                if error is not None:
                    yield check_of(row.name, subject, error, instants, allowed[row.name], conditioning)


def check_of(
    kind: str,
    subject: str,
    error: Array,
    instants: RecordInstants | Array,
    tolerance: Tolerance,
    conditioning: Array | None = None,
) -> Check:
    """Return the check of an error (n,), 0 or more, at instants (n,) against a tolerance in its unit.

    Instants in a plain array are crank angles in [rad]. The tolerance of each instant is wider where the
    conditioning (n,) is poor.
    """
    if not isinstance(instants, RecordInstants):
        instants = RecordInstants(instants, "rad")
    allowed = tolerance.widened(conditioning, len(error))
    # NaN is the worst error, and so is any error with a tolerance of 0
    fraction = np.divide(error, allowed, out=np.where(error > 0.0, np.inf, error), where=allowed > 0.0)
    index = int(np.argmax(np.where(np.isnan(fraction), np.inf, fraction)))
    reason = tolerance.reason
    if conditioning is not None and allowed[index] > tolerance.value:
        factor = allowed[index] / tolerance.value
        reason += f"; x {factor:.3g} at a loop conditioning of {conditioning[index]:.2g}"
    return Check(
        kind=kind,
        subject=subject,
        unit=tolerance.unit,
        worst=float(error[index]),
        instant=float(instants.value[index]),
        at_unit=instants.unit,
        rms=float(np.sqrt(np.mean(error**2))),
        tolerance=float(allowed[index]),
        reason=reason,
    )


def concluded(
    checks: Iterable[Check],
    elsewhere: Callable[[], float | None] | None = None,
    unit: InstantUnit = "rad",
) -> Verdict:
    """Return the verdict of checks.

    Args:
        checks: the checks of all quantities.
        elsewhere: returns the first instant at which a failed simulation is in another assembly mode, as a
            crank angle in [rad] or a time in [s]; None if it never is.
        unit: unit of that instant.
    """
    checks = tuple(checks)
    if not checks:
        return Verdict("failed", (), "nothing was compared")
    failed = [check for check in checks if not check.passed]
    if not failed:
        return Verdict("passed", checks)
    where = None if elsewhere is None else elsewhere()
    if where is not None:
        return Verdict("changed assembly", checks, f"first seen at {instant_text(where, unit)}")
    if not all(check.worst == check.worst for check in checks):
        return Verdict("diverged", checks, "an error is not a number")
    names = [f"{check.title} {_beyond(check)}" for check in failed]
    return Verdict("failed", checks, f"beyond the tolerance: {first_names(names, 3)}")


def combined(verdicts: Mapping[str, Verdict]) -> Verdict:
    """Return the verdict over several methods: the most severe outcome, its method, and all checks."""
    method, worst = list(verdicts.items())[most_severe(verdict.outcome for verdict in verdicts.values())]
    checks = [replace(check, method=name) for name, verdict in verdicts.items() for check in verdict.checks]
    return Verdict(worst.outcome, tuple(checks), f"{method}: {worst.reason}" if worst.reason else "")


def _beyond(check: Check) -> str:
    """Return in words by how much a check failed."""
    if check.tolerance > 0.0:
        return f"by {check.worst / check.tolerance:.3g} times"
    return f"by {check.worst:.3g} {check.unit} where none is allowed"
