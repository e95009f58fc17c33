"""Speed against accuracy: what every setting costs and how far it errs, measured for one scene."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from mechsim.files import written_beside
from mechsim.numerics.arrays import Array
from mechsim.numerics.convergence import Order, cheapest, observed_order, pareto
from mechsim.simulation import Settings
from mechsim.studies.tradeoff.setting_families import DEFAULTS, Build, Family
from mechsim.studies.tradeoff.subject import COMPARED, Subject

BOUNDS = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
# between rounding and the size of the mechanism an error says something of the order
FLOOR, CEILING = 1e-12, 0.1


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
        return median(self.times)

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
        unbuilt: trials of models that cannot be made or do not close.
        untried: families of which the budget had no time for a single trial.
        seconds: on the clock.
    """

    subject: Subject
    points: Sequence[Point]
    left_out: int
    unbuilt: int
    untried: Sequence[str]
    seconds: float

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

    def curves(self) -> dict[str, list[Point]]:
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
            "unbuilt": self.unbuilt,
            "untried": list(self.untried),
            "seconds": self.seconds,
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


def advice(point: Point, model: str, speed: float) -> dict[str, str | None]:
    """Return what gives a point's settings.

    Args:
        point: of a trade-off.
        model: name or file that was measured.
        speed: of the crank, in [rad/s].

    Returns:
        "command": `mechsim simulate` with its options, None where it takes another drive or a reduction;
        "export": `mechsim export` of a model that has the settings, None where no file can say them;
        "xml": a fragment of MJCF, None where no file can say it all; "python": lines that run.
    """
    return {
        "command": command(point, model, speed),
        "export": exporting(point, model, speed),
        "xml": fragment(point, speed),
        "python": snippet(point, model, speed),
    }


def command(point: Point, model: str, speed: float) -> str | None:
    """Return the call of `mechsim simulate` that runs a point; None where it has no option for its model."""
    build = point.family.build
    if (build.drive, build.rod, build.variant) != (Build().drive, None, None):
        return None
    told = [_option(name, value) for name, value in _changed(point.settings).items()]
    told += [f"--cut {','.join(build.cut)}"] if build.cut else []
    told += [f"--scene {build.level}"] if build.level != Build().level else []
    return " ".join(["mechsim", "simulate", model, "--speed", f"{speed!r}rad/s", *told])


def exporting(point: Point, model: str, speed: float) -> str | None:
    """Return the call of `mechsim export` that writes a point's settings; None where no file can say them."""
    settings = point.settings
    if model.endswith(".xml") or fragment(point, speed) is None:
        return None
    # what a run makes of what it was not told
    file = replace(settings, solref=_solref(settings, speed), iterations=1, residual=0.0)
    left = {"steps_per_turn", "constant_steps", "compliance", "drive_inertia"}
    told = {one.name: getattr(file, one.name) for one in fields(Settings) if one.name not in left}
    options = [_option(name, _plain(value)) for name, value in told.items() if value is not None]
    return " ".join(["mechsim", "export", model, f"--timestep {settings.timestep(speed)!r}", *options])


def _solref(settings: Settings, speed: float) -> tuple[float, float]:
    return settings.solref or (settings.constant * settings.timestep(speed), 1.0)


def fragment(point: Point, speed: float) -> str | None:
    """Return the MJCF that says a point's settings; None where softness is scaled after compiling."""
    settings = point.settings
    if settings.compliance_used != 1.0 or point.family.build != Build():
        return None
    timestep = settings.timestep(speed)
    solref = _solref(settings, speed)
    safe = "enable" if settings.refsafe else "disable"
    exact = ' diagexact="enable"' if settings.diagexact else ""
    return (
        f'<option timestep="{timestep!r}" integrator="{settings.integrator}" iterations="1" tolerance="0">'
        f'<flag refsafe="{safe}" island="disable"{exact}/></option>\n'
        f'<default><equality solref="{_words(solref)}" solimp="{_words(settings.solimp)}"/></default>'
    )


def snippet(point: Point, model: str, speed: float) -> str:
    """Return lines of Python that run a point."""
    settings = ", ".join(f"{name}={value!r}" for name, value in _changed(point.settings).items())
    build = ", ".join(
        f"{one.name}={getattr(point.family.build, one.name)!r}"
        for one in fields(Build)
        if getattr(point.family.build, one.name) != one.default
    )
    source = f"pathlib.Path({model!r})" if model.endswith(".xml") else "source.mechanism"
    lines = ["import pathlib", ""] if model.endswith(".xml") else ["import mechsim as ms"]
    lines += ["from mechsim.simulation import Settings"]
    lines += ["from mechsim.studies.tradeoff import Build, build_model", ""]
    variants = ""
    if not model.endswith(".xml"):
        lines.append(f"source = ms.load({model!r})")
        if point.family.build.variant is not None:
            lines.append("variants = {name: one.mechanism for name, one in source.variants().items()}")
            variants = ", variants"
    lines.append(f"built = build_model({source}, None, {speed!r}, Build({build}){variants})")
    lines.append(f"motion, seconds = built.motion(Settings({settings}))")
    return "\n".join(lines)


def _changed(settings: Settings) -> dict[str, Any]:
    """Return the settings that are not the default's; steps always."""
    told = {one.name: getattr(settings, one.name) for one in fields(Settings)}
    usual = {one.name: one.default for one in fields(Settings)}
    return {
        name: _plain(value)
        for name, value in told.items()
        if name == "steps_per_turn" or value != usual[name]
    }


def _plain(value: Any) -> Any:
    return tuple(float(one) for one in value) if isinstance(value, tuple | np.ndarray) else value


def _option(name: str, value: Any) -> str:
    """Return a setting as an option of the command line."""
    name = name.replace("_", "-")
    if isinstance(value, bool):
        return f"--{name}" if value else f"--no-{name}"
    if isinstance(value, tuple):
        return f"--{name}={','.join(f'{one:.17g}' for one in value)}"
    return f"--{name} {value!r}" if isinstance(value, float) else f"--{name} {value}"


def _words(values: tuple[float, ...]) -> str:
    return " ".join(f"{one:.17g}" for one in values)
