"""Time budgets: seconds left on the clock, and the expected time of the next trial."""

from collections.abc import Hashable
from dataclasses import dataclass, field
from time import perf_counter, process_time

import numpy as np

from mechsim.errors import InputError
from mechsim.simulation import Settings

# how far what comes next may be beyond what was expected of it: of trials measured before, and of others
MEASURED_MARGIN, NEW_MARGIN = 1.2, 2.0
# part of a budget by which it may be overdrawn
BEYOND = 0.2
# weight of the latest trial in the mean of the fixed cost of a trial (reference, errors, matrices compared)
LATEST = 0.5


@dataclass(frozen=True, slots=True)
class Budget:
    """Time on the clock that may be spent.

    Attributes:
        seconds: all of it.
        began: when it began to run, by `time.perf_counter`.
        reserved: of it, for what comes after the measurements.
    """

    seconds: float
    began: float = field(default_factory=perf_counter)
    reserved: float = 0.0

    @property
    def spent(self) -> float:
        """Seconds gone."""
        return perf_counter() - self.began

    @property
    def remaining(self) -> float:
        """Seconds left for measurements; below 0 where there are none."""
        return self.seconds - self.reserved - self.spent

    @property
    def fraction(self) -> float:
        """The spent fraction, 0 to 1."""
        return min(1.0, self.spent / self.seconds)

    def require(self, name: str) -> None:
        """Refuse to go on with something loaded and built for which there is no time left.

        Raises:
            InputError: says what it took, and a budget that would do: trying it takes as long again.
        """
        if self.remaining < 0.0:
            raise InputError(
                f"{name} took {self.spent:.2g} s to load and build, but the budget is {self.seconds:g} s; "
                f"give --budget {np.ceil(self.reserved + 4.0 * self.spent):g}s or more"
            )


class TrialTimes:
    """What trials took so far, in processor time, and so what the next would take on the clock.

    Others may have their share of the machine: the clock has run so many times as fast as the processor's.
    """

    def __init__(self) -> None:
        self._began = perf_counter(), process_time()
        self._steps: dict[tuple[Hashable, str], tuple[int, float]] = {}
        self._overhead: float | None = None
        self._building = 0.0

    @property
    def share(self) -> float:
        """Seconds on the clock in which the processor worked one for us."""
        wall, processor = perf_counter() - self._began[0], process_time() - self._began[1]
        return max(0.5, wall / processor) if processor > 0.01 else 1.0

    def trial(self, build: Hashable, settings: Settings, turns: float) -> float:
        """Return what a trial is expected to take on the clock, in [s]; with its model if that is new."""
        key = build, settings.integrator
        slowest = max((each for _, each in self._steps.values()), default=0.0)
        each = self._steps[key][1] if key in self._steps else slowest
        safety = MEASURED_MARGIN if key in self._steps else NEW_MARGIN
        model = 0.0 if any(build == other for other, _ in self._steps) else self._building
        return self.share * (
            model + (self._overhead or 0.0) + safety * turns * settings.steps_per_turn * each
        )

    def built(self, seconds: float) -> None:
        """Take note of what a model took to be built, in [s] of processor time."""
        self._building = max(self._building, seconds)

    def learn(self, build: Hashable, settings: Settings, turns: float, stepping: float, whole: float) -> None:
        """Take note of a trial: processor time of its steps, and of all of it, in [s]."""
        count = round(turns * settings.steps_per_turn)
        longest = self._steps.get((build, settings.integrator), (0, 0.0))
        # the fixed cost of a run counts less the longer the run is
        if count >= longest[0]:
            self._steps[build, settings.integrator] = count, stepping / count
        overhead = max(0.0, whole - stepping)
        previous = overhead if self._overhead is None else self._overhead
        self._overhead = previous + LATEST * (overhead - previous)
