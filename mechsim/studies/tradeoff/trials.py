"""Trials of settings within a time budget; the relevant settings are timed again in rounds.

Each round runs all of them in a new order, so that a slow period of the computer affects all.
"""

from collections.abc import Sequence

import numpy as np

from mechsim.numerics.resources import Budget, Progress, no_progress
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.studies.tradeoff.methods import LOW_COMPLIANCE, STEPS, Subject, stepping_methods
from mechsim.studies.tradeoff.work_precision import Point, Tradeoff

# number of timing rounds including the first trials, and fraction of the budget left for the later rounds
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
        budget: wall time in [s], after which no trial begins; a first trial with low compliance is always
            made, and those left out are reported.
        seed: random seed for the order of trials and timing rounds.
        steps: numbers of steps per revolution.
        progress: callback after each trial.
    """
    random, time = np.random.default_rng(seed), budget if isinstance(budget, Budget) else Budget(budget)
    turns, methods = subject.built.profile.turns, stepping_methods()
    settings = [(method, n) for method in methods for n in steps]
    order = [settings[i] for i in random.permutation(len(settings))]
    order.sort(key=lambda pair: (pair[0].name != LOW_COMPLIANCE or pair[1] > min(steps), pair[0].rank))
    points = list[Point]()
    for method, n in order:
        if points and time.remaining < TIMING_FRACTION * time.seconds:
            break
        own = method.settings(n, subject.speed)
        motion, seconds = subject.built.motion(own)
        points.append(Point(method, own, subject.errors(motion), [seconds / turns]))
        progress(f"{method.name}, {n} steps", time.fraction)
    relevant = _relevant(points)
    for number in range(1, TIMING_ROUNDS):
        for point in (relevant[i] for i in random.permutation(len(relevant))):
            if time.remaining > 0.0:
                point.times.append(subject.built.stepped(point.settings)[1].processor / turns)
                progress(f"timing, round {number + 1}", time.fraction)
    points.sort(key=lambda point: settings.index((point.method, point.settings.steps_per_turn)))
    tried = {point.method.name for point in points}
    return Tradeoff(
        subject,
        points,
        left_out=len(methods) * len(steps) - len(points),
        untried=tuple(method.name for method in methods if method.name not in tried),
        seconds=time.spent,
    )


def _relevant(points: Sequence[Point]) -> list[Point]:
    """Return the points on the front, those slightly above it, and those for comparison."""
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
