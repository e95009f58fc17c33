"""Checks of quantities against their bounds, and the verdict they come to."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import Any

import numpy as np

from mechsim.model.finding import Outcome, most_severe
from mechsim.numerics.arrays import Array
from mechsim.verdict.quantities import QUANTITIES, ComparedQuantity
from mechsim.verdict.tolerances import (
    FRACTION_OF,
    InstantUnit,
    RecordInstants,
    Requested,
    Tolerance,
    ToleranceRule,
    instant_text,
    instants_of,
)

Tolerances = Mapping[str, Tolerance]


@dataclass(frozen=True, slots=True, kw_only=True)
class Check:
    """One quantity of a verdict.

    Attributes:
        kind: what was compared, a name of `QUANTITIES` or words of its own.
        subject: point, link or joint; empty for the whole.
        method: "pose", "step" or another; empty if the verdict covers one method only.
        variant: of the mechanism, where it tells of several.
        unit: of worst, rms and tolerance.
        worst: error where it is the largest part of its bound.
        at: crank angle there in [rad], or time in [s] where motion laws drive, as `at_unit` has it.
        at_unit: "rad", "s", or "row" of a table without times.
        rms: root mean square of the error over the run.
        tolerance: largest error allowed there.
        reason: for the tolerance.
    """

    kind: str
    subject: str = ""
    method: str = ""
    variant: str = ""
    unit: str
    worst: float
    at: float
    at_unit: InstantUnit = "rad"
    rms: float
    tolerance: float
    reason: str

    @property
    def quantity(self) -> str:
        """The quantity and its subject in words, after the variant if there is one."""
        return f"{self.variant}, {self._name}" if self.variant else self._name

    @property
    def title(self) -> str:
        """Variant, method, quantity and subject in words."""
        label = ", ".join(filter(None, (self.variant, self.method)))
        return f"{label}: {self._name}" if self.method else self.quantity

    @property
    def _name(self) -> str:
        row = QUANTITIES.get(self.kind)
        return row.said(self.subject) if row else self.kind

    @property
    def passed(self) -> bool:
        """Whether the worst error is within the bound; NaN is not."""
        return self.worst <= self.tolerance

    @property
    def fraction_of_tolerance(self) -> float | None:
        """The part of its bound that the worst error uses; None where that is no number."""
        return self.worst / self.tolerance if np.isfinite(self.worst) and self.tolerance > 0.0 else None

    @property
    def cells(self) -> tuple[str, str, str, str, str, str, str]:
        """The check as a row of `check_table`."""
        at = f"{self.at:g}" if self.at_unit == "row" else f"{self.at:.4f}"
        numbers = f"{self.worst:.2e}", at, f"{self.tolerance:.1e}"
        return self.title, *numbers, self.unit, "PASS" if self.passed else "FAIL", self.reason

    def as_dict(self) -> dict[str, Any]:
        """Return the check as plain data."""
        names = ("quantity", "method", "unit", "worst", "at", "at_unit", "rms", "tolerance", "reason")
        return {name: getattr(self, name) for name in names} | {"passed": self.passed}

    def __str__(self) -> str:
        relation = "<=" if self.passed else "> " if self.worst == self.worst else "? "
        return (
            f"{self.title:<34} {self.worst:9.2e} {relation} {self.tolerance:8.1e} {self.unit:<6} "
            f"at {self.at:7.4f} {self.at_unit}  ({self.reason})"
        )


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a comparison came to; print it to see the table.

    Attributes:
        outcome: one of "passed", "failed", "diverged", "changed assembly", "cannot assemble".
        checks: quantity by quantity.
        reason: one sentence where the outcome is not "passed".
    """

    outcome: Outcome
    checks: tuple[Check, ...]
    reason: str = ""

    @property
    def passed(self) -> bool:
        """Whether every quantity is within its bound."""
        return self.outcome == "passed"

    def as_dict(self) -> dict[str, Any]:
        """Return the verdict as plain data."""
        return {
            "passed": self.passed,
            "outcome": self.outcome,
            "reason": self.reason,
            "checks": [check.as_dict() for check in self.checks],
        }

    def __str__(self) -> str:
        head = self.outcome if not self.reason else f"{self.outcome}: {self.reason}"
        return "\n".join([head, *(f"  {check}" for check in self.checks)])

    __repr__ = __str__


def check_table(checks: Sequence[Check]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return the heading and the rows of a table of checks."""
    units = sorted({check.at_unit for check in checks})
    at = f"at [{units[0]}]" if len(units) == 1 else "at"
    rows: list[tuple[str, ...]] = []
    for check in checks:
        quantity, worst, place, *rest = check.cells
        rows.append((quantity, worst, place if len(units) == 1 else f"{place} {check.at_unit}", *rest))
    return ("quantity", "worst", at, "tolerance", "unit", "", "reason"), rows


def tolerances_of(
    rows: Iterable[ComparedQuantity],
    method: str,
    scales: Mapping[str, float],
    asked: Requested,
    given: Tolerances | None = None,
) -> dict[str, Tolerance]:
    """Return the tolerances of quantities that have a bound by a road, and in their place those given."""
    found: dict[str, Tolerance] = {}
    for row in rows:
        own = None if given is None else given.get(row.name)
        if own is not None and own.unit == "1" != row.unit:
            part = ToleranceRule(FRACTION_OF + own.reason, own.value)
            found[row.name] = part.tolerance(row.unit, scales[row.scale], Requested())
        elif own is not None:
            found[row.name] = own
        elif method in row.bounds:
            bound = row.bounds[method]
            found[row.name] = bound.tolerance(row.unit, scales[bound.scale or row.scale], asked)
    return found


def checks_of(
    rows: Iterable[ComparedQuantity],
    found: Any,
    exact: Any,
    allowed: Tolerances,
    conditioning: Array | None = None,
) -> Iterator[Check]:
    """Compare two records in some quantities: subject by subject, each in all quantities of its kind.

    Args:
        rows: the quantities.
        found: what is judged.
        exact: what it should be.
        allowed: tolerances by quantity.
        conditioning: of the loops at each instant, (n,), by which bounds widen; None where it is not known.
    """
    instants = instants_of(found)
    for over, group in groupby(rows, lambda row: row.over):
        among = tuple(group)
        for subject in over(found, exact):
            for row in among:
                error = row.error(found, exact, subject)
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

    Instants that are a bare array are crank angles in [rad].

    Every instant is held against the bound there, which widens where the conditioning (n,) is poor.
    """
    if not isinstance(instants, RecordInstants):
        instants = RecordInstants(instants, "rad")
    bound = tolerance.widened(conditioning, len(error))
    # NaN counts as the worst there is; where nothing is allowed, any error does
    part = np.divide(error, bound, out=np.where(error > 0.0, np.inf, error), where=bound > 0.0)
    at = int(np.argmax(np.where(np.isnan(part), np.inf, part)))
    why, wider = tolerance.reason, bound[at] > tolerance.value
    if wider and conditioning is not None:
        times = bound[at] / tolerance.value
        why += f"; x {times:.3g} where the loops' conditioning is {conditioning[at]:.2g}"
    return Check(
        kind=kind,
        subject=subject,
        unit=tolerance.unit,
        worst=float(error[at]),
        at=float(instants.value[at]),
        at_unit=instants.unit,
        rms=float(np.sqrt(np.mean(error**2))),
        tolerance=float(bound[at]),
        reason=why,
    )


def concluded(
    checks: Iterable[Check],
    elsewhere: Callable[[], float | None] | None = None,
    unit: InstantUnit = "rad",
) -> Verdict:
    """Return the verdict that checks come to.

    Args:
        checks: quantity by quantity.
        elsewhere: where a simulation that missed is first seen in another assembly, as a crank angle in
            [rad] or a time in [s]; None where it is in none.
        unit: of that.
    """
    found = tuple(checks)
    failed = [check for check in found if not check.passed]
    if not failed:
        return Verdict("passed", found)
    where = None if elsewhere is None else elsewhere()
    if where is not None:
        return Verdict("changed assembly", found, f"first seen at {instant_text(where, unit)}")
    if not all(check.worst == check.worst for check in found):
        return Verdict("diverged", found, "an error is not a number")
    names = ", ".join(f"{check.title} {_beyond(check)}" for check in failed[:3])
    more = f" and {len(failed) - 3} more" if len(failed) > 3 else ""
    return Verdict("failed", found, f"beyond the tolerance: {names}{more}")


def combined(verdicts: Mapping[str, Verdict]) -> Verdict:
    """Return the verdict over several roads: the gravest outcome and whose it is, and each road's checks."""
    road, worst = list(verdicts.items())[most_severe(verdict.outcome for verdict in verdicts.values())]
    checks = [replace(check, method=name) for name, one in verdicts.items() for check in one.checks]
    return Verdict(worst.outcome, tuple(checks), f"{road}: {worst.reason}" if worst.reason else "")


def _beyond(check: Check) -> str:
    """Return by how much a check failed, in words."""
    if check.tolerance > 0.0:
        return f"by {check.worst / check.tolerance:.3g} times"
    return f"by {check.worst:.3g} {check.unit} where none is allowed"
