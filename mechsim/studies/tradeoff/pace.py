"""The clock of a trade-off: what is left of its budget, and what a trial or a model would take of that."""

from dataclasses import dataclass, field
from time import perf_counter, process_time

import numpy as np

from mechsim.errors import InputError
from mechsim.simulation import Settings
from mechsim.studies.tradeoff.model_builds import Build

# how far what comes next may be beyond what was expected of it: of trials measured before, and of others
KNOWN, UNKNOWN = 1.2, 2.0
# part of a budget by which it may be overdrawn
BEYOND = 0.2
# weight of the latest trial in what a trial takes beside its steps: reference, errors, matrices compared
LATEST = 0.5


@dataclass(frozen=True, slots=True)
class Budget:
    """Time on the clock that may be spent.

    Attributes:
        seconds: all of it.
        began: when it began to run, by `time.perf_counter`.
        kept: of it, for what comes after the measurements.
    """

    seconds: float
    began: float = field(default_factory=perf_counter)
    kept: float = 0.0

    @property
    def spent(self) -> float:
        """Seconds gone."""
        return perf_counter() - self.began

    @property
    def left(self) -> float:
        """Seconds left for measurements; below 0 where there are none."""
        return self.seconds - self.kept - self.spent

    @property
    def part(self) -> float:
        """The part of it that is gone, 0 to 1."""
        return min(1.0, self.spent / self.seconds)

    def require(self, name: str) -> None:
        """Refuse to go on with something loaded and built for which there is no time left.

        Raises:
            InputError: says what it took, and a budget that would do: trying it takes as long again.
        """
        if self.left < 0.0:
            raise InputError(
                f"{name} took {self.spent:.2g} s to load and build, but the budget is {self.seconds:g} s; "
                f"give --budget {np.ceil(self.kept + 4.0 * self.spent):g}s or more"
            )


class Pace:
    """What trials took so far, in processor time, and so what the next would take on the clock.

    Others may have their share of the machine: the clock has run so many times as fast as the processor's.
    """

    def __init__(self) -> None:
        self._began = perf_counter(), process_time()
        self._steps: dict[tuple[Build, str], tuple[int, float]] = {}
        self._overhead: float | None = None
        self._building = 0.0

    @property
    def share(self) -> float:
        """Seconds on the clock in which the processor worked one for us."""
        wall, processor = perf_counter() - self._began[0], process_time() - self._began[1]
        return max(0.5, wall / processor) if processor > 0.01 else 1.0

    def trial(self, build: Build, settings: Settings, turns: float) -> float:
        """Return what a trial is expected to take on the clock, in [s]; with its model if that is new."""
        key = build, settings.integrator
        slowest = max((each for _, each in self._steps.values()), default=0.0)
        each = self._steps[key][1] if key in self._steps else slowest
        margin = KNOWN if key in self._steps else UNKNOWN
        model = 0.0 if any(build == known for known, _ in self._steps) else self._building
        return self.share * (
            model + (self._overhead or 0.0) + margin * turns * settings.steps_per_turn * each
        )

    def built(self, seconds: float) -> None:
        """Take note of what a model took to be built, in [s] of processor time."""
        self._building = max(self._building, seconds)

    def learn(self, build: Build, settings: Settings, turns: float, stepping: float, whole: float) -> None:
        """Take note of a trial: processor time of its steps, and of all of it, in [s]."""
        count = round(turns * settings.steps_per_turn)
        known = self._steps.get((build, settings.integrator), (0, 0.0))
        # what a run costs beside its steps counts the less the longer it is
        if count >= known[0]:
            self._steps[build, settings.integrator] = count, stepping / count
        beside = max(0.0, whole - stepping)
        known_beside = beside if self._overhead is None else self._overhead
        self._overhead = known_beside + LATEST * (beside - known_beside)
