"""Trials of settings within a time budget; the relevant settings are timed again in rounds.

Each round runs all of them in a new order, so that a slow period of the computer affects all.
"""

from collections.abc import Sequence

import numpy as np

from mechsim.model.progress import Progress, no_progress
from mechsim.simulation.mjcf import quiet
from mechsim.studies.budget import Budget, TrialTimes
from mechsim.studies.tradeoff.methods import (
    DEFAULTS,
    LOW_COMPLIANCE,
    STEPS,
    SteppingMethod,
    stepping_methods,
)
from mechsim.studies.tradeoff.subject import Subject
from mechsim.studies.tradeoff.work_precision import Point, Tradeoff

# number of timing rounds including the first trials, and largest fraction of the budget for the later rounds
TIMING_ROUNDS, TIMING_FRACTION = 5, 0.4
# cost relative to that of the front at the same error, above which settings are not timed again
MAX_COST_RATIO = 2.0


@quiet()
def measure_tradeoff(
    subject: Subject,
    *,
    budget: float | Budget = 60.0,
    seed: int = 0,
    steps: Sequence[int] = STEPS,
    progress: Progress = no_progress,
) -> Tradeoff:
    """Measure all settings on one subject.

    Args:
        subject: the subject.
        budget: wall time in [s]; trials that would exceed it are omitted and reported, except the shortest
            trial with low compliance.
        seed: random seed for the order of trials and timing rounds.
        steps: numbers of steps per revolution.
        progress: callback after each trial.
    """
    random = np.random.default_rng(seed)
    settings = [(method, n) for method in stepping_methods() for n in steps]
    order = sorted(range(len(settings)), key=dict(enumerate(random.permutation(len(settings)))).__getitem__)
    order.sort(key=lambda i: settings[i][0].rank)
    trials = _Trials(subject, settings, budget if isinstance(budget, Budget) else Budget(budget), progress)
    # the shortest run of the most expensive integrator limits the expected time of the others
    first = [
        settings.index((method, min(steps)))
        for name in (LOW_COMPLIANCE, DEFAULTS)
        for method in trials.named(name)
    ]
    for i in first:
        if not trials.points or trials.has_time(i):
            trials.run(i)
    for i in order:
        if i not in first and trials.has_time(i, trials.timing_seconds()):
            trials.run(i)
    trials.time_again(random)
    for i in order:
        if i not in trials.points and trials.has_time(i):
            trials.run(i)
    return trials.result()


class _Trials:
    """Measured points by the index of their settings."""

    def __init__(
        self,
        subject: Subject,
        settings: Sequence[tuple[SteppingMethod, int]],
        budget: Budget,
        progress: Progress,
    ) -> None:
        self.subject, self.settings, self.budget, self.progress = subject, settings, budget, progress
        self.turns = subject.built.profile.turns
        self.points: dict[int, Point] = {}
        self.times = TrialTimes(budget)

    def named(self, name: str) -> list[SteppingMethod]:
        """Return the methods with a name."""
        return list(dict.fromkeys(method for method, _ in self.settings if method.name == name))

    def has_time(self, i: int, reserved: float = 0.0) -> bool:
        """Return whether a trial fits the budget with a reserve, and the reference is finer."""
        method, n = self.settings[i]
        if n > self.subject.reference.max_steps:
            return False
        expected = self.times.expected(method.base.integrator, self.turns * n)
        return expected <= self.budget.remaining - reserved

    def run(self, i: int) -> None:
        """Run a trial."""
        method, n = self.settings[i]
        settings = method.settings(n, self.subject.speed)
        start = self.budget.processor()
        motion, seconds = self.subject.built.motion(settings)
        errors = self.subject.errors(motion)
        total = self.budget.processor() - start
        self.times.add_trial(settings.integrator, self.turns * n, seconds, total)
        self.points[i] = Point(method, settings, errors, [seconds / self.turns])
        self.progress(f"{method.name}, {n} steps", self.budget.fraction)

    def time_again(self, random: np.random.Generator) -> None:
        """Time the relevant points again, each round in a new order, while the budget lasts."""
        relevant = self._relevant()
        for number in range(1, TIMING_ROUNDS):
            for i in random.permutation(len(relevant)):
                point = relevant[i]
                if self._expected(point) > self.budget.remaining:
                    continue
                steps = self.subject.built.stepped(point.settings)[1]
                point.times.append(steps.processor / self.turns)
                self.progress(f"timing, round {number + 1}", self.budget.fraction)

    def result(self) -> Tradeoff:
        """Return the measured points, and the numbers of the other trials."""
        left_out = [method.name for i, (method, _) in enumerate(self.settings) if i not in self.points]
        points = [self.points[i] for i in sorted(self.points)]
        tried = {point.method.name for point in points}
        return Tradeoff(
            self.subject,
            points,
            left_out=len(left_out),
            untried=tuple(name for name in dict.fromkeys(left_out) if name not in tried),
            seconds=self.budget.spent,
        )

    def timing_seconds(self) -> float:
        """Return the expected wall time of the later timing rounds in [s], limited by the budget fraction."""
        expected = (TIMING_ROUNDS - 1) * sum(self._expected(point) for point in self._relevant())
        return min(TIMING_FRACTION * self.budget.seconds, expected)

    def _relevant(self) -> list[Point]:
        """Return the points on the front, those slightly above it, and those for comparison."""
        points = list(self.points.values())
        costs = np.array([point.cost for point in points])
        errors = np.array([point.errors["position"] for point in points])
        ascending = np.argsort(errors)
        last_equal = np.searchsorted(errors[ascending], errors, side="right") - 1
        least = np.minimum.accumulate(costs[ascending])[last_equal]
        return [
            point
            for point, cost, error, best in zip(points, costs, errors, least, strict=True)
            if np.isfinite(error) and (point.method.rank == 0 or cost <= MAX_COST_RATIO * best)
        ]

    def _expected(self, point: Point) -> float:
        settings = point.settings
        return self.times.expected(settings.integrator, self.turns * settings.steps_per_turn)
