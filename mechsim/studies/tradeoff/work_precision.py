"""Speed against accuracy: what every setting costs and how far it errs, measured for one scene.

Within a time budget every family of settings climbs a ladder of steps a turn; then the points that
matter are timed again, one after the other in rounds, so that a slow minute of the machine falls on all.
"""

import csv
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mechsim.errors import MechsimError
from mechsim.files import written_beside
from mechsim.maths.arrays import Array
from mechsim.maths.convergence import Order, cheapest, observed_order, pareto
from mechsim.simulation import Settings
from mechsim.simulation.mjcf import quiet
from mechsim.studies.tradeoff.built_model import BuiltModel, build_model
from mechsim.studies.tradeoff.ladder import DEFAULTS, STEPS, Family, families
from mechsim.studies.tradeoff.model_builds import Build
from mechsim.studies.tradeoff.subject import COMPARED, Subject

BOUNDS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
# part of the budget spent on first trials, and rounds of timing after them
FIRST_PART, ROUNDS = 0.6, 5
# points this much dearer than the front's at the same error are not timed again
NEAR = 2.0
# between rounding and the size of the mechanism an error says something of the order
FLOOR, CEILING = 1e-12, 0.1
# in [s], what a step may cost before one was measured
STEP_COST = 2e-5


@dataclass(slots=True)
class Point:
    """One setting: what it costs and how far it errs.

    Attributes:
        family: it belongs to.
        settings: with the number of steps.
        errors: quantity -> worst error; see `Subject.errors`.
        times: processor time of stepping one turn, in [s], a value for each time it was measured.
    """

    family: Family
    settings: Settings
    errors: dict[str, float]
    times: list[float] = field(default_factory=list[float])

    @property
    def cost(self) -> float:
        """The median processor time of stepping one turn, in [s]."""
        return float(np.median(self.times))

    def as_dict(self) -> dict[str, Any]:
        """Return the point as a row of the CSV and of the JSON."""
        return {
            "family": self.family.name,
            "integrator": self.settings.integrator,
            "steps_per_turn": self.settings.steps_per_turn,
            "defaults": self.family.name == DEFAULTS,
            **self.family.build.as_dict(),
            "seconds_per_turn": self.cost,
            "timed": len(self.times),
            **{f"{kind}_error": self.errors[kind] for kind in COMPARED},
        }


@dataclass(frozen=True, slots=True)
class Tradeoff:
    """The points measured on one scene.

    Attributes:
        subject: what they were measured on.
        points: all of them, in the order of the ladder.
        left_out: trials that the budget had no time for.
    """

    subject: Subject
    points: Sequence[Point]
    left_out: int

    def errors(self, quantity: str = "position") -> Array:
        """Return the error of each point in one quantity."""
        return np.array([point.errors[quantity] for point in self.points])

    @property
    def costs(self) -> Array:
        """The cost of each point, in [s] a turn."""
        return np.array([point.cost for point in self.points])

    def front(self, quantity: str = "position") -> list[Point]:
        """Return the points that nothing beats in both cost and error, by rising cost."""
        return [self.points[i] for i in pareto(self.costs, self.errors(quantity))]

    def choice(self, bound: float, quantity: str = "position") -> Point | None:
        """Return the cheapest point with an error within a bound; None if none has.

        A reference with an error bar of its own lends no more than it has: the bar is added.
        """
        bar = self.subject.reference.bar.get(quantity, 0.0)
        best = cheapest(self.costs, self.errors(quantity) + bar, bound)
        return None if best is None else self.points[best]

    def curves(self, quantity: str = "position") -> dict[str, list[Point]]:
        """Return family -> its points by rising steps, in the order of the ladder."""
        names = dict.fromkeys(point.family.name for point in self.points)
        found = {name: [p for p in self.points if p.family.name == name] for name in names}
        return {name: sorted(ps, key=lambda p: p.settings.steps_per_turn) for name, ps in found.items()}

    def order(self, curve: Sequence[Point], quantity: str = "position") -> Order | None:
        """Return the observed order of a curve."""
        floor = max(FLOOR, 3.0 * self.subject.reference.bar.get(quantity, 0.0))
        steps = [point.settings.steps_per_turn for point in curve]
        errors = [point.errors[quantity] for point in curve]
        return observed_order(steps, errors, floor=floor, ceiling=CEILING)

    def best_curves(self, quantity: str = "position") -> dict[str, list[Point]]:
        """Return the curve of each integrator that holds most of its own front, and MuJoCo's defaults."""
        best: dict[str, list[Point]] = {}
        curves = self.curves()
        for integrator in dict.fromkeys(point.settings.integrator for point in self.points):
            mine = [
                p for p in self.points if p.settings.integrator == integrator and p.family.name != DEFAULTS
            ]
            among = pareto([p.cost for p in mine], [p.errors[quantity] for p in mine])
            names = [mine[i].family.name for i in among]
            if names:
                name = max(dict.fromkeys(names), key=names.count)
                best[name] = curves[name]
        return best | ({DEFAULTS: curves[DEFAULTS]} if DEFAULTS in curves else {})

    def as_dict(self, quantity: str = "position") -> dict[str, Any]:
        """Return what `mechsim tradeoff --json` prints."""
        chosen = {bound: self.choice(bound, quantity) for bound in BOUNDS}
        orders = {name: self.order(curve, quantity) for name, curve in self.best_curves(quantity).items()}
        return {
            "mechanism": self.subject.name,
            "reference": self.subject.reference.what,
            "reference_error": dict(self.subject.reference.bar),
            "quantity": quantity,
            "stroke": self.subject.stroke,
            "trials": len(self.points),
            "left_out": self.left_out,
            "recommended": [
                {"bound": bound, "point": None if point is None else self._described(point)}
                for bound, point in chosen.items()
            ],
            "pareto": [point.as_dict() for point in self.front(quantity)],
            "orders": {
                name: None if order is None else {"order": order.order, "low": order.low, "high": order.high}
                for name, order in orders.items()
            },
            "points": [point.as_dict() for point in self.points],
        }

    def _described(self, point: Point) -> dict[str, Any]:
        return point.as_dict() | {"settings": point.settings.as_dict()}


@quiet()
def measure(
    subject: Subject,
    *,
    budget: float = 60.0,
    seed: int = 0,
    steps: Sequence[int] = STEPS,
    tell: Callable[[float, str], None] = lambda _part, _done: None,
) -> Tradeoff:
    """Measure the ladder on one subject.

    Args:
        subject: what to measure on.
        budget: in [s]; trials that would not end in time are left out and counted.
        seed: of the order of trials and of timing rounds.
        steps: numbers of steps a turn.
        tell: called after each piece of work with the part of the budget spent, and what was done.
    """
    begin, random = clock.perf_counter(), np.random.default_rng(seed)

    def spent() -> float:
        return clock.perf_counter() - begin

    ladder = [(family, n) for family in families(subject.mechanism, subject.variants) for n in steps]
    order = sorted(range(len(ladder)), key=dict(enumerate(random.permutation(len(ladder)))).__getitem__)
    order.sort(key=lambda i: ladder[i][0].rank)
    models: dict[Build, BuiltModel | None] = {subject.built.build: subject.built}
    points: dict[int, Point] = {}
    overhead = 0.05
    for i in order:
        family, n = ladder[i]
        if spent() + overhead + n * STEP_COST > FIRST_PART * budget and points:
            continue
        model = _model(models, subject, family)
        if model is None:
            continue
        before = spent()
        settings = family.at(n, subject.speed)
        motion, seconds = model.motion(settings)
        errors = subject.errors(motion)
        points[i] = Point(family, settings, errors, [seconds / model.profile.turns])
        overhead = 0.5 * (overhead + max(0.0, spent() - before - seconds))
        tell(min(1.0, spent() / budget), f"{family.name}, {n} steps")
    found = Tradeoff(subject, [points[i] for i in sorted(points)], len(ladder) - len(points))
    _time_again(found, models, random, lambda: budget - spent(), lambda what: tell(spent() / budget, what))
    return found


def _model(models: dict[Build, BuiltModel | None], subject: Subject, family: Family) -> BuiltModel | None:
    """Return the model of a family's build, made once; None where it cannot be made or does not close."""
    if family.build not in models:
        try:
            models[family.build] = build_model(
                subject.source, subject.built.profile, subject.speed, family.build, subject.variants
            )
        except MechsimError:
            models[family.build] = None
    return models[family.build]


def _time_again(
    found: Tradeoff,
    models: dict[Build, BuiltModel | None],
    random: np.random.Generator,
    left: Callable[[], float],
    tell: Callable[[str], None],
) -> None:
    """Time the points that matter again, each round in a new order, as long as there is time left."""
    costs, errors = found.costs, found.errors()
    near = [
        point
        for point, cost, error in zip(found.points, costs, errors, strict=True)
        if np.isfinite(error)
        and (point.family.rank == 0 or cost <= NEAR * costs[errors <= error].min(initial=np.inf))
    ]
    for number in range(1, ROUNDS):
        for i in random.permutation(len(near)):
            point = near[i]
            model = models[point.family.build]
            if model is None or 2.0 * point.cost * model.profile.turns > left():
                continue
            point.times.append(model.stepped(point.settings)[1].processor / model.profile.turns)
            tell(f"timing, round {number + 1}")


def write_csv(path: str | Path, found: Tradeoff, quantity: str = "position") -> None:
    """Write every point as a row, those on the Pareto front marked.

    Raises:
        OutputError: where the file cannot be written.
    """
    front = {id(point) for point in found.front(quantity)}
    rows = [point.as_dict() | {"pareto": id(point) in front} for point in found.points]
    with written_beside(path) as beside, beside.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
