"""One run at an extreme, how it ended, and whether that is true; the border between two endings."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.errors import MechsimError
from mechsim.model.finding import Outcome
from mechsim.simulation import Run, simulate
from mechsim.verdict.judge import crosscheck

# bound on the place of any tracked point, in units of the mechanism's size
PLACE = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One run at an extreme.

    Attributes:
        axis: what was pushed.
        mechanism: of the catalogue, with a word on what was changed.
        value: how far, in the unit of the axis.
        outcome: what the simulator says of itself, without the closed form.
        right: what the closed form says of the same run.
        foretold: what the closed form says before the run; None where it does not know.
        error: worst place error against the closed form, in units of the size; None where there is none.
    """

    axis: str
    mechanism: str
    value: float
    outcome: Outcome
    right: Outcome
    foretold: Outcome | None = None
    error: float | None = None

    @property
    def passed(self) -> bool:
        """Whether the run ended as it had to, and knew it."""
        return self.outcome == self.right and self.foretold in (None, self.outcome)

    def as_dict(self) -> dict[str, Any]:
        """Return the trial as plain data."""
        return asdict(self) | {"passed": self.passed}


@dataclass(frozen=True, slots=True, kw_only=True)
class Border:
    """Where one outcome gives way to another.

    Attributes:
        axis, mechanism: as of the trials.
        inside, outside: neighbouring values, as near as the bisection came.
        before, after: outcomes at them.
    """

    axis: str
    mechanism: str
    inside: float
    outside: float
    before: Outcome
    after: Outcome

    def as_dict(self) -> dict[str, Any]:
        """Return the border as plain data."""
        return asdict(self)


Attempt = Callable[[float], Trial]


def attempt(
    axis: str,
    drive: ClosedForm,
    value: float,
    source: Any,
    *,
    foretold: Outcome | None = None,
    reachable: bool = False,
    note: str = "",
    **how: Any,
) -> Trial:
    """Run a source in MuJoCo and judge the run by the closed form of a drive.

    Args:
        axis, value, foretold: as of the trial.
        drive: gives the truth.
        source: what `simulate` takes.
        reachable: whether the closed form knows that the crank can go there, so that a refusal is wrong.
        note: what was changed.
        how: other arguments of `simulate`.
    """
    made = Trial(
        axis=axis,
        mechanism=f"{drive.name} {note}".strip(),
        value=value,
        outcome="cannot assemble",
        right="cannot assemble",
        foretold=foretold,
    )
    how.setdefault("method", "step")
    try:
        run = simulate(source, **how)
    except MechsimError:
        return replace(made, right=foretold or ("passed" if reachable else "cannot assemble"))
    right, error = _truth(drive, run)
    return replace(made, outcome=_said(run, drive), right=right, error=error)


def _said(run: Run, drive: ClosedForm) -> Outcome:
    """Return the simulator's own verdict for the bound of this study."""
    if run.outcome == "passed" and not run.estimate <= PLACE * drive.mechanism.size:
        return "failed"
    return run.outcome


def _truth(drive: ClosedForm, run: Run) -> tuple[Outcome, float | None]:
    """Return the closed form's verdict on the places alone, and the worst error in units of the size."""
    if run.motion.broken:
        return "diverged", None
    size = drive.mechanism.size
    try:
        exact = drive.positions(run.motion.angle)
    except MechsimError:
        return "failed", None
    gaps = [np.sqrt(((run.motion.points[n].position - p) ** 2).sum(1)).max() for n, p in exact.items()]
    error = float(max(gaps)) / size
    if not np.isfinite(error):
        return "diverged", None
    if error <= PLACE:
        return "passed", error
    judged = crosscheck(run.motion, drive, tolerance=PLACE * size).outcome
    return ("changed assembly" if judged == "changed assembly" else "failed"), error


def pushed(attempted: Attempt, values: Sequence[float], halvings: int) -> tuple[list[Trial], list[Border]]:
    """Try values along an axis and find, by bisection of their logarithms, where the outcome changes."""
    trials = [attempted(value) for value in values]
    borders: list[Border] = []
    found = list(trials)
    for first, second in pairwise(trials):
        if first.outcome == second.outcome or first.mechanism != second.mechanism:
            continue
        a, b, between = first, second, list[Trial]()
        for _ in range(halvings if first.value > 0.0 and second.value > 0.0 else 0):
            middle = attempted(float(np.sqrt(a.value * b.value)))
            between.append(middle)
            a, b = (middle, b) if middle.outcome == first.outcome else (a, middle)
        found += between
        borders.append(
            Border(
                axis=first.axis,
                mechanism=first.mechanism,
                inside=a.value,
                outside=b.value,
                before=a.outcome,
                after=b.outcome,
            )
        )
    return sorted(found, key=lambda trial: trial.value), borders
