"""Time budgets of studies: remaining seconds of a clock, and the expected time of the next trial."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter, process_time

import numpy as np

from mechsim.errors import InputError

TimeSource = Callable[[], float]
# largest ratio of actual to expected time: of trials similar to measured ones, and of others
MEASURED_MARGIN, NEW_MARGIN = 1.2, 2.0
# fraction of a budget by which it may be exceeded
MAX_EXCESS = 0.2
# weight of the latest trial in the mean of the fixed cost of a trial (reference, errors, matrices compared)
LATEST_WEIGHT = 0.5


@dataclass(frozen=True, slots=True)
class Budget:
    """Time that may be spent, by a clock.

    Attributes:
        seconds: all of it.
        start: reading of the clock at which it begins; None for now.
        reserved: seconds reserved for work after the measurements.
        now: reads the wall clock in [s]; tests pass their own.
        processor: processor time of this process in [s].
    """

    seconds: float
    start: float | None = None
    reserved: float = 0.0
    now: TimeSource = field(default_factory=lambda: perf_counter)
    processor: TimeSource = field(default_factory=lambda: process_time)

    def __post_init__(self) -> None:
        """Read the clock if no start is given."""
        if self.start is None:
            object.__setattr__(self, "start", self.now())

    @property
    def spent(self) -> float:
        """Seconds since the start."""
        assert self.start is not None
        return self.now() - self.start

    @property
    def remaining(self) -> float:
        """Seconds left for measurements; negative after the end."""
        return self.seconds - self.reserved - self.spent

    @property
    def fraction(self) -> float:
        """The spent fraction, 0 to 1."""
        return min(1.0, self.spent / self.seconds)

    def share(self, fraction: float) -> "Budget":
        """Return a budget that starts now, with a fraction of the seconds."""
        return replace(self, seconds=fraction * self.seconds, start=None, reserved=0.0)

    def restarted(self) -> "Budget":
        """Return the same budget, starting now."""
        return replace(self, start=None)

    def require(self, name: str) -> None:
        """Reject a budget that ends before a subject is loaded and built.

        Raises:
            InputError: with the time used and a sufficient budget; a trial is assumed to take as long again.
        """
        if self.remaining < 0.0:
            raise InputError(
                f"{name} took {self.spent:.2g} s to load and build, but the budget is {self.seconds:g} s; "
                f"give --budget {np.ceil(self.reserved + 4.0 * self.spent):g}s or more"
            )


class TrialTimes:
    """Predicts the wall time of trials from the processor time of earlier ones.

    Other processes may use the machine: wall time is processor time divided by this process' share of it.

    Args:
        budget: its clocks are read.
    """

    def __init__(self, budget: Budget) -> None:
        self._budget, self._start = budget, (budget.now(), budget.processor())
        # integrator -> number of steps of its longest run, and seconds of each
        self._steps: dict[str, tuple[int, float]] = {}
        self._overhead: float | None = None

    @property
    def wall_ratio(self) -> float:
        """Wall time over processor time since the start."""
        wall = self._budget.now() - self._start[0]
        processor = self._budget.processor() - self._start[1]
        return max(0.5, wall / processor) if processor > 0.01 else 1.0

    def expected(self, integrator: str, steps: float) -> float:
        """Return the expected wall time of a trial in [s]."""
        slowest = max((seconds for _, seconds in self._steps.values()), default=0.0)
        seconds = self._steps[integrator][1] if integrator in self._steps else slowest
        safety = MEASURED_MARGIN if integrator in self._steps else NEW_MARGIN
        return self.wall_ratio * ((self._overhead or 0.0) + safety * steps * seconds)

    def add_trial(self, integrator: str, steps: float, stepping: float, total: float) -> None:
        """Record a trial: processor time of its steps, and of all of it, in [s]."""
        count = round(steps)
        # the fixed cost has less weight in longer runs
        if count >= self._steps.get(integrator, (0, 0.0))[0]:
            self._steps[integrator] = count, stepping / count
        overhead = max(0.0, total - stepping)
        previous = overhead if self._overhead is None else self._overhead
        self._overhead = previous + LATEST_WEIGHT * (overhead - previous)
