"""Work-precision results of a trade-off: points, fronts, recommendations, their measurement and use.

Settings are tried within a time budget, and the relevant ones are timed again in rounds. Each round runs all
of them in a new order, so that a slow period of the computer affects all.
"""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from mechsim.files import atomic_path, attributes
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.convergence import Order, cheapest, observed_order, pareto
from mechsim.numerics.resources import Budget, Progress, no_progress
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.settings import OWN_OPTIONS, Settings
from mechsim.studies.tradeoff.methods import (
    COMPARED,
    DEFAULTS,
    LOW_COMPLIANCE,
    STEPS,
    SteppingMethod,
    Subject,
    stepping_methods,
)

# errors in strokes for which the fastest settings are listed
BOUNDS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
# errors, in strokes, between which the order of convergence is measured
MIN_ERROR, MAX_ERROR = 1e-12, 0.1


# number of timing rounds including the first trials, and fraction of the budget left for the later rounds
TIMING_ROUNDS, TIMING_FRACTION = 5, 0.4
# cost relative to that of the front at the same error, above which settings are not timed again
MAX_COST_RATIO = 2.0


@dataclass(slots=True)
class Point:
    """The cost and the errors of one setting.

    Attributes:
        method: stepping method.
        settings: settings with the number of steps.
        errors: quantity -> largest error; see `Subject.errors`.
        times: processor time of stepping one revolution in [s], one value for each measurement.
    """

    method: SteppingMethod
    settings: Settings
    errors: dict[str, float]
    times: list[float] = field(default_factory=list[float])

    @property
    def cost(self) -> float:
        """The median processor time of stepping one revolution, in [s]."""
        return median(self.times)

    def as_dict(self) -> dict[str, Any]:
        """Return the point as a row of the CSV and of the JSON."""
        return {
            "method": self.method.name,
            "integrator": self.settings.integrator,
            "steps_per_turn": self.settings.steps_per_turn,
            "defaults": self.method.name == DEFAULTS,
            "seconds_per_turn": self.cost,
            "timed": len(self.times),
            **{f"{kind}_error": self.errors[kind] for kind in COMPARED},
        }


@dataclass(frozen=True, slots=True)
class Tradeoff:
    """The points measured on one scene.

    Attributes:
        subject: subject of the measurement.
        points: all points, in the order of the methods.
        left_out: number of trials omitted for lack of time.
        untried: methods without a single trial for lack of time.
        seconds: wall time.
    """

    subject: Subject
    points: Sequence[Point]
    left_out: int
    untried: Sequence[str]
    seconds: float

    def errors(self, quantity: str = "position") -> Array:
        """Return the error of each point in one quantity."""
        return np.array([point.errors[quantity] for point in self.points])

    @property
    def costs(self) -> Array:
        """The cost of each point, in [s] per revolution."""
        return np.array([point.cost for point in self.points])

    def front(self, quantity: str = "position") -> list[Point]:
        """Return the Pareto front, by increasing cost: points that no other beats in both cost and error."""
        return [self.points[i] for i in pareto(self.costs, self.errors(quantity))]

    def choice(self, max_error: float, quantity: str = "position") -> Point | None:
        """Return the cheapest point whose error is within the limit; or None."""
        best = cheapest(self.costs, self.errors(quantity), max_error)
        return None if best is None else self.points[best]

    def curves(self) -> dict[str, list[Point]]:
        """Return method -> its points by ascending steps, in the order of the methods."""
        curves: dict[str, list[Point]] = {point.method.name: [] for point in self.points}
        for point in sorted(self.points, key=lambda point: point.settings.steps_per_turn):
            curves[point.method.name].append(point)
        return curves

    def order(self, curve: Sequence[Point], quantity: str = "position") -> Order | None:
        """Return the observed order of a curve."""
        steps = [point.settings.steps_per_turn for point in curve]
        errors = [point.errors[quantity] for point in curve]
        return observed_order(steps, errors, floor=MIN_ERROR, ceiling=MAX_ERROR)

    def best_curves(self, quantity: str = "position") -> dict[str, list[Point]]:
        """Return each integrator's curve with most points on its own front, and that of MuJoCo's defaults."""
        best: dict[str, list[Point]] = {}
        curves = self.curves()
        for integrator in dict.fromkeys(point.settings.integrator for point in self.points):
            mine = [
                p for p in self.points if p.settings.integrator == integrator and p.method.name != DEFAULTS
            ]
            among = pareto([p.cost for p in mine], [p.errors[quantity] for p in mine])
            names = [mine[i].method.name for i in among]
            if names:
                name = max(dict.fromkeys(names), key=names.count)
                best[name] = curves[name]
        return best | ({DEFAULTS: curves[DEFAULTS]} if DEFAULTS in curves else {})

    def as_dict(self, quantity: str = "position") -> dict[str, Any]:
        """Return the output of `mechsim tradeoff --json`, with the period of a turn or cycle in [s]."""
        orders = {name: self.order(curve, quantity) for name, curve in self.best_curves(quantity).items()}
        return {
            "mechanism": self.subject.name,
            "reference": self.subject.solver.method,
            "quantity": quantity,
            "stroke": self.subject.stroke,
            "period": REVOLUTION / self.subject.speed,
            "trials": len(self.points),
            **attributes(self, "left_out", "untried", "seconds"),
            "recommended": [
                {"limit": limit, "point": point and point.as_dict() | {"settings": point.settings.as_dict()}}
                for limit, point in ((limit, self.choice(limit, quantity)) for limit in BOUNDS)
            ],
            "pareto": [point.as_dict() for point in self.front(quantity)],
            "orders": orders,
            "points": [point.as_dict() for point in self.points],
        }


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


def write_csv(path: str | Path, result: Tradeoff, quantity: str = "position") -> None:
    """Write every point as a row with a mark for the Pareto front.

    Raises:
        OutputError: if the file cannot be written.
    """
    front = {id(point) for point in result.front(quantity)}
    rows = [point.as_dict() | {"pareto": id(point) in front} for point in result.points]
    with atomic_path(path) as temporary, temporary.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def command_of(point: Point, model: str, subject: Subject) -> str:
    """Return the call of `mechsim simulate` for a point, at a crank speed in rpm if that number is short."""
    speed, crank = subject.speed, subject.solver.motion_laws.crank
    short = f"{speed * 60.0 / REVOLUTION:g}"
    is_exact = np.isclose(float(short) * REVOLUTION / 60.0, speed, rtol=1e-12)
    speed_text = f"{short}rpm" if is_exact else f"{speed!r}rad/s"
    motion = ("--speed", speed_text) if crank else ("--timestep", repr(point.settings.timestep(speed)))
    defaults = {field.name: field.default for field in fields(Settings)}
    options = [
        _option(name, value)
        for name, value in point.settings.as_dict().items()
        if (crank if name == "steps_per_turn" else value != defaults[name])
    ]
    return " ".join(["mechsim", "simulate", model, *motion, *options])


def _option(name: str, value: Any) -> str:
    """Return a setting as an option of the command line."""
    if name in OWN_OPTIONS:
        return f"--{name.replace('_', '-')} {value!r}"
    text = ",".join(f"{number:.17g}" for number in value) if isinstance(value, tuple) else value
    return f"--setting {name}={str(text).lower() if isinstance(value, bool) else text}"
