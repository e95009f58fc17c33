"""Results of a stress test: its runs, and the borders between outcomes."""

from dataclasses import dataclass, field
from typing import ClassVar

from mechsim.model.finding import Outcome


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One run at an extreme.

    Attributes:
        axis: the varied quantity.
        mechanism: name in the catalogue.
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


@dataclass
class StabilityMap:
    """The result of a study.

    Attributes:
        trials: all runs.
        borders: borders between outcomes along an axis.
    """

    JSON: ClassVar[tuple[str, ...]] = ("passed", "borders", "trials")

    trials: list[Trial] = field(default_factory=list[Trial])
    borders: list[Border] = field(default_factory=list[Border])

    @property
    def passed(self) -> bool:
        """Whether every run ended as the closed form requires."""
        return not self.wrong

    @property
    def wrong(self) -> list[Trial]:
        """The runs with another outcome."""
        return [trial for trial in self.trials if not trial.passed]
