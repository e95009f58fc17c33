"""The trials: within a time budget every family of settings climbs a ladder of steps a turn.

Then the points that matter are timed again, one after the other in rounds, so that a slow minute of the
machine falls on all.
"""

from collections.abc import Callable, Sequence
from time import process_time

import numpy as np

from mechsim.errors import MechsimError
from mechsim.simulation.mjcf import quiet
from mechsim.studies.budget import Budget, TrialTimes
from mechsim.studies.tradeoff.models import BuiltModel, build_model
from mechsim.studies.tradeoff.setting_families import DEFAULTS, HARD, STEPS, Build, Family, families
from mechsim.studies.tradeoff.subject import Subject
from mechsim.studies.tradeoff.work_precision import Point, Tradeoff

# rounds of timing, the first trials among them, and the part of the budget that is kept for the others
ROUNDS, KEPT = 5, 0.4
# points this much dearer than the front's at the same error are not timed again
NEAR = 2.0

Tell = Callable[[float, str], None]


@quiet()
def measure(
    subject: Subject,
    *,
    budget: float | Budget = 60.0,
    seed: int = 0,
    steps: Sequence[int] = STEPS,
    tell: Tell = lambda _part, _done: None,
) -> Tradeoff:
    """Measure the ladder on one subject.

    Args:
        subject: what to measure on.
        budget: in [s] on the clock, from now on or from when it began; trials that would not end in time
            are left out and told, but for the shortest of the hard loop.
        seed: of the order of trials and of timing rounds.
        steps: numbers of steps a turn.
        tell: called after each piece of work with the part of the budget spent, and what was done.
    """
    random = np.random.default_rng(seed)
    ladder = [(family, n) for family in families(subject.mechanism, subject.variants) for n in steps]
    order = sorted(range(len(ladder)), key=dict(enumerate(random.permutation(len(ladder)))).__getitem__)
    order.sort(key=lambda i: ladder[i][0].rank)
    work = _Trials(subject, ladder, budget if isinstance(budget, Budget) else Budget(budget), tell)
    # the shortest of the dearest integrator says what others may take
    sure = [ladder.index((family, min(steps))) for name in (HARD, DEFAULTS) for family in work.named(name)]
    for i in sure:
        if not work.points or work.has_time(i):
            work.trial(i)
    for i in order:
        if i not in sure and work.has_time(i, work.rounds()):
            work.trial(i)
    work.time_again(random)
    for i in order:
        if work.late(i) and work.has_time(i):
            work.trial(i)
    return work.found()


class _Trials:
    """The trials as they go: models made and points measured, by their places in the ladder."""

    def __init__(
        self, subject: Subject, ladder: Sequence[tuple[Family, int]], budget: Budget, tell: Tell
    ) -> None:
        self.subject, self.ladder, self.budget, self.tell = subject, ladder, budget, tell
        self.turns = subject.built.profile.turns
        self.models: dict[Build, BuiltModel | None] = {subject.built.build: subject.built}
        self.points: dict[int, Point] = {}
        self.pace = TrialTimes()
        self.pace.built(subject.built.seconds)

    def named(self, name: str) -> list[Family]:
        """Return the family of a name, once."""
        return list(dict.fromkeys(family for family, _ in self.ladder if family.name == name))

    def late(self, i: int) -> bool:
        """Whether there was no time for a trial; its model can be made, as far as that is known."""
        return i not in self.points and self.models.get(self.ladder[i][0].build, True) is not None

    def has_time(self, i: int, kept: float = 0.0) -> bool:
        """Whether there is time for a trial, and so many seconds, and a reference finer than it."""
        family, n = self.ladder[i]
        if n > self.subject.reference.most_steps:
            return False
        expected = self.pace.trial(family.build, family.at(n, self.subject.speed), self.turns)
        return expected <= self.budget.remaining - kept

    def trial(self, i: int) -> None:
        """Make a trial, if its model can be made."""
        family, n = self.ladder[i]
        settings = family.at(n, self.subject.speed)
        model = self._model(family)
        if model is None:
            return
        begun = process_time()
        motion, seconds = model.motion(settings)
        errors = self.subject.errors(motion)
        self.pace.learn(family.build, settings, self.turns, seconds, process_time() - begun)
        self.points[i] = Point(family, settings, errors, [seconds / self.turns])
        self.tell(self.budget.fraction, f"{family.name}, {n} steps")

    def time_again(self, random: np.random.Generator) -> None:
        """Time the points that matter again, each round in a new order, as long as there is time left."""
        near = self._near()
        for number in range(1, ROUNDS):
            for i in random.permutation(len(near)):
                point = near[i]
                model = self.models[point.family.build]
                if model is None or self._expected(point) > self.budget.remaining:
                    continue
                point.times.append(model.stepped(point.settings)[1].processor / self.turns)
                self.tell(self.budget.fraction, f"timing, round {number + 1}")

    def found(self) -> Tradeoff:
        """Return what was measured, and how much was not."""
        late = [family.name for i, (family, _) in enumerate(self.ladder) if self.late(i)]
        points = [self.points[i] for i in sorted(self.points)]
        tried = {point.family.name for point in points}
        return Tradeoff(
            self.subject,
            points,
            left_out=len(late),
            unbuilt=len(self.ladder) - len(points) - len(late),
            untried=tuple(name for name in dict.fromkeys(late) if name not in tried),
            seconds=self.budget.spent,
        )

    def rounds(self) -> float:
        """Return what timing again is expected to take, in [s]; no more than is kept for it."""
        wanted = (ROUNDS - 1) * sum(self._expected(point) for point in self._near())
        return min(KEPT * self.budget.seconds, wanted)

    def _model(self, family: Family) -> BuiltModel | None:
        """Return the model of a family's build, made once; None where it cannot be made or does not close."""
        subject = self.subject
        if family.build not in self.models:
            try:
                made = build_model(
                    subject.source, subject.built.profile, subject.speed, family.build, subject.variants
                )
                self.pace.built(made.seconds)
                self.models[family.build] = made
            except MechsimError:
                self.models[family.build] = None
        return self.models[family.build]

    def _near(self) -> list[Point]:
        """Return the points on the front, close above it, and of the settings that all are compared with."""
        points = list(self.points.values())
        costs = np.array([point.cost for point in points])
        errors = np.array([point.errors["position"] for point in points])
        rising = np.argsort(errors)
        as_good = np.searchsorted(errors[rising], errors, side="right") - 1
        least = np.minimum.accumulate(costs[rising])[as_good]
        return [
            point
            for point, cost, error, best in zip(points, costs, errors, least, strict=True)
            if np.isfinite(error) and (point.family.rank == 0 or cost <= NEAR * best)
        ]

    def _expected(self, point: Point) -> float:
        return self.pace.trial(point.family.build, point.settings, self.turns)
