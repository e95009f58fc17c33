"""The command tradeoff: speed against accuracy, measured."""

from pathlib import Path
from typing import Annotated, Any

import typer

from mechsim import units
from mechsim.cli import exit_codes
from mechsim.cli.declared_options import spread
from mechsim.cli.options import Json, Output, Sets, Speed, form_of, speed_of, writable
from mechsim.cli.output import print_json, print_table
from mechsim.cli.progress import Tick, progress
from mechsim.cli.scene_options import SceneOptions, user_scene
from mechsim.errors import InputError
from mechsim.pictures import plots
from mechsim.studies.budget import BEYOND
from mechsim.studies.reduction.scene_costs import SceneCost, scene_costs
from mechsim.studies.scene import spec_of
from mechsim.studies.tradeoff import (
    BOUNDS,
    COMPARED,
    DEFAULTS,
    Budget,
    Point,
    Subject,
    Tradeoff,
    measure,
    subject_of,
    subject_of_model,
    write_csv,
)
from mechsim.studies.tradeoff.plot import work_precision
from mechsim.studies.tradeoff.work_precision import advice

# in [s], kept of the budget for the table, and for a plot
TOLD, DRAWN = 0.1, 0.7
# of the families that were not tried
NAMED = 3


@spread
def tradeoff(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL", help="A catalogue name, FILE.toml, FILE.py:OBJECT, or an MJCF file of your own."
        ),
    ],
    *,
    costs: Annotated[
        bool, typer.Option("--costs", help="Tell instead what each thing in a scene of your own costs.")
    ] = False,
    asked: SceneOptions,
    speed: Speed = "600rpm",
    budget: Annotated[
        str, typer.Option(help="Time to spend on all of it, by the clock; a bare number is seconds.")
    ] = "60s",
    seed: Annotated[int, typer.Option(help="Of the order of trials.", min=0)] = 0,
    by: Annotated[
        str, typer.Option(help="Error that counts: position, velocity, acceleration, angle, loop or drive.")
    ] = "position",
    plot: Annotated[
        str | None, typer.Option(metavar="FILE", help="Work-precision plot: .svg, .png or .pdf.")
    ] = None,
    sets: Sets = None,
    output: Output = None,
    as_json: Json = False,
) -> None:
    """Measure how fast and how accurate MuJoCo's settings are on one mechanism; recommend some."""
    if costs:
        if sets or output or plot:
            raise InputError("--costs measures an MJCF file as it is; leave out --set, --plot and -o")
        print_costs(model, asked, as_json=as_json)
        return
    if asked != SceneOptions():
        raise InputError("--drive, --ctrl, --key, --track and --duration are for --costs; give it too")
    place = None if output is None else writable(output, ".csv")
    drawing = None if plot is None else writable(plot, ".svg", ".png", ".pdf")
    if by not in COMPARED:
        raise InputError(f"there is no error by {by!r}; known are {', '.join(COMPARED)}")
    clock = _clock(budget, drawn=drawing is not None)
    with progress("tradeoff", 100) as tick:
        subject = _subject(model, sets, speed_of(speed), clock)
        found = measure(subject, budget=clock, seed=seed, progress=_Percent(tick))
    if place is not None:
        write_csv(place, found, by)
    if drawing is not None:
        plots.write(drawing, work_precision(found, by))
    if as_json:
        told = {"seed": seed, "budget": clock.seconds, "output": output, "plot": plot}
        print_json(_advised(found.as_dict(by), found, by, model) | told)
    else:
        _print(found, by)
        _print_advice(found, by, model)
        for what, path in (("every point", output), ("plot", plot)):
            if path is not None:
                typer.echo(f"wrote {what} to {path}")
    if clock.spent > (1.0 + BEYOND) * clock.seconds:
        exit_codes.tell(
            f"mechsim: took {clock.spent:.2g} s, more than the budget of {clock.seconds:g} s: a short "
            "trial, with what must be loaded and built for it, takes that long here"
        )


def _clock(budget: str, *, drawn: bool) -> Budget:
    """Return the clock of a budget, by which some time is kept for what is told and drawn."""
    seconds = units.parse_time(budget, "the budget")
    if not 0.0 < seconds < float("inf"):
        raise InputError(f"the budget is {budget}; give a time above 0, as in 60s")
    return Budget(seconds, exit_codes.typed_at, min(TOLD + (DRAWN if drawn else 0.0), 0.5 * seconds))


def _subject(model: str, sets: list[str] | None, speed: float, clock: Budget) -> Subject:
    path = Path(model)
    if path.suffix.lower() != ".xml":
        return subject_of(form_of(model, sets), speed, clock)
    if sets:
        raise InputError(f"--set changes a mechanism of the catalogue; {model!r} is an MJCF file")
    return subject_of_model(path, path.stem, speed, clock)


class _Percent:
    """Turns parts of the budget into ticks of a bar of 100."""

    def __init__(self, tick: Tick):
        self.tick, self.shown = tick, 0

    def __call__(self, done: str, part: float) -> None:
        while self.shown < min(100, int(100.0 * part)):
            self.shown += 1
            self.tick(done)


def _print(found: Tradeoff, by: str) -> None:
    subject = found.subject
    rows = [(f"{bound:.0e}", *_cells(found.choice(bound, by))) for bound in BOUNDS]
    rows += [("(defaults)", *_cells(point)) for point in found.points if _worth(point, DEFAULTS)]
    head = ("error within", "use", "steps a turn", "ms a turn", *found.points[0].errors)
    print_table(f"{subject.name} against {subject.reference.what}: by {by}", head, rows)
    typer.echo(
        "position and loop in strokes, velocity and acceleration in strokes and crank speed, "
        f"angle and drive in rad; stroke {subject.stroke:.4g} m"
    )
    if subject.reference.bar:
        bars = ", ".join(f"{kind} {bar:.1e}" for kind, bar in subject.reference.bar.items())
        typer.echo(f"error of the reference itself: {bars}")
    for name, curve in found.best_curves(by).items():
        order = found.order(curve, by)
        if order is not None:
            typer.echo(f"{name}: order {order.order:.2f} ({order.low:.2f} to {order.high:.2f})")
    typer.echo(_count(found))


def _advised(told: dict[str, Any], found: Tradeoff, by: str, model: str) -> dict[str, Any]:
    """Return what is told with what to do about each recommendation."""
    for one in told["recommended"]:
        point = found.choice(one["bound"], by)
        one["advice"] = None if point is None else advice(point, model, found.subject.speed)
    return told


def _print_advice(found: Tradeoff, by: str, model: str) -> None:
    """Say of each recommendation what to type, once for those that are alike."""
    said: dict[str, list[float]] = {}
    for bound in BOUNDS:
        point = found.choice(bound, by)
        if point is not None:
            told = advice(point, model, found.subject.speed)
            lines = [told["command"] or told["python"] or "", told["export"] or ""]
            lines = [one for one in (*lines, *(told["xml"] or "").splitlines()) if one]
            said.setdefault("\n  ".join(lines).strip(), []).append(bound)
    for lines, bounds in said.items():
        typer.echo(f"{', '.join(f'{bound:.0e}' for bound in bounds)}:\n  {lines}")


def _count(found: Tradeoff) -> str:
    """Return how much of the ladder was measured, and what was not and why."""
    said = [f"{len(found.points)} settings measured in {found.seconds:.3g} s"]
    if found.unbuilt:
        said.append(f"{found.unbuilt} do not assemble")
    if found.left_out:
        said.append(f"{found.left_out} left out for want of time")
    if found.untried:
        named = ", ".join(found.untried[:NAMED])
        more = f" and {len(found.untried) - NAMED} more" if len(found.untried) > NAMED else ""
        said.append(f"nothing was tried of {named}{more}")
    return "; ".join(said)


def _worth(point: Any, defaults: str) -> bool:
    return point.method.name == defaults and point.settings.steps_per_turn in (72, 720, 7200)


def _cells(point: Point | None) -> tuple[str, ...]:
    if point is None:
        return ("nothing measured reaches it", "", "")
    errors = (f"{error:.1e}" for error in point.errors.values())
    return (point.method.name, str(point.settings.steps_per_turn), f"{1e3 * point.cost:.3g}", *errors)


def print_costs(model: str, asked: SceneOptions, *, as_json: bool) -> None:
    """Measure and print what each thing in a scene costs."""
    scene = user_scene(model, asked)
    with progress("costs", None) as tick:
        found = scene_costs(scene, spec_of(scene), progress=tick)
    if as_json:
        print_json({"scene": model, "timestep": float(scene.model.opt.timestep), "costs": _rows(found)})
        return
    rows = [
        (
            one.what,
            str(one.dofs),
            str(one.rows),
            f"{one.step:.3g}",
            f"{one.ratio:.3g}",
            f"{one.error:.1e}" if one.error < float("inf") else "diverges",
        )
        for one in found
    ]
    head = ("scene", "freedoms", "rows", "us/step", "of the scene", "error [m]")
    print_table(f"{model}: what each thing costs", head, rows)


def _rows(found: list[SceneCost]) -> list[dict[str, object]]:
    return [
        {
            "what": one.what,
            "freedoms": one.dofs,
            "rows": one.rows,
            "us_per_step": one.step,
            "time_ratio": one.ratio,
            "error": one.error,
        }
        for one in found
    ]
