"""Results of a stress test: its runs, the borders between outcomes, and the errors of long runs."""

from dataclasses import dataclass, field
from typing import ClassVar

from mechsim.model.finding import Outcome

# ratio of the last errors to the first above which they drift
MAX_GROWTH = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One run at an extreme.

    Attributes:
        axis: the varied quantity.
        mechanism: name in the catalogue, with a note on the change.
        value: value in the unit of the axis.
        outcome: outcome that the simulator reports without the closed form.
        right: outcome of the same run by the closed form.
        expected: outcome that the closed form predicts; None if it cannot.
        error: largest position error relative to the closed form, in characteristic lengths; None without a
            run.
    """

    JSON: ClassVar[tuple[str, ...]] = (
        "axis",
        "mechanism",
        "value",
        "outcome",
        "right",
        "error",
        "expected",
        "passed",
    )

    axis: str
    mechanism: str
    value: float
    outcome: Outcome
    right: Outcome
    expected: Outcome | None = None
    error: float | None = None

    @property
    def passed(self) -> bool:
        """Whether the run has the outcome that the closed form requires, and reports it."""
        return self.outcome == self.right and self.expected in (None, self.outcome)


@dataclass(frozen=True, slots=True, kw_only=True)
class Border:
    """The border between two outcomes along an axis.

    Attributes:
        axis, mechanism: those of the trials.
        inside, outside: neighbouring values after bisection.
        before, after: outcomes at these values.
    """

    axis: str
    mechanism: str
    inside: float
    outside: float
    before: Outcome
    after: Outcome


@dataclass(frozen=True, slots=True)
class Drift:
    """Position errors of a long run relative to the closed form.

    Attributes:
        mechanism: name.
        turns: number of revolutions.
        first: largest error in the first hundredth of the run, in characteristic lengths.
        last: largest error in the last hundredth of the run.
    """

    JSON: ClassVar[tuple[str, ...]] = ("mechanism", "turns", "first", "last", "passed")

    mechanism: str
    turns: float
    first: float
    last: float

    @property
    def passed(self) -> bool:
        """Whether the error did not grow."""
        return self.last <= MAX_GROWTH * self.first


@dataclass
class StabilityMap:
    """The result of a study.

    Attributes:
        trials: all runs.
        borders: borders between outcomes along an axis.
        drifts: position errors of the long runs.
    """

    JSON: ClassVar[tuple[str, ...]] = ("passed", "borders", "drifts", "trials")

    trials: list[Trial] = field(default_factory=list[Trial])
    borders: list[Border] = field(default_factory=list[Border])
    drifts: list[Drift] = field(default_factory=list[Drift])

    @property
    def passed(self) -> bool:
        """Whether every run ended as the closed form requires, and no long run drifted."""
        return not self.wrong and all(drift.passed for drift in self.drifts)

    @property
    def wrong(self) -> list[Trial]:
        """The runs with another outcome."""
        return [trial for trial in self.trials if not trial.passed]
