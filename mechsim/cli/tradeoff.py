"""Command `mechsim tradeoff`: measured speed and accuracy of MuJoCo's settings."""

from typing import Annotated, Any

import typer

from mechsim import units
from mechsim.cli import exit_codes
from mechsim.cli.command import PLOTS, Result, Stated, command, one_of_each, table_or_plot_file
from mechsim.cli.options import Model, ModelOptions, Sets, Speed
from mechsim.cli.output import Value, number, print_table, print_text
from mechsim.cli.progress import progress
from mechsim.errors import InputError, several
from mechsim.numerics.arrays import REVOLUTION
from mechsim.numerics.resources import Budget
from mechsim.pictures import plots
from mechsim.report.study_plots import work_precision
from mechsim.studies.tradeoff.methods import COMPARED, DEFAULTS, subject_of
from mechsim.studies.tradeoff.work_precision import BOUNDS, Tradeoff, command_of, measure_tradeoff, write_csv
from mechsim.units import crank_speed, option

# maximum number of printed families of settings without a trial
MAX_FAMILIES = 3
# steps per revolution at which MuJoCo's defaults are printed
DEFAULTS_STEPS = (72, 720, 7200)


@command
def tradeoff(
    model: Model,
    stated: Stated,
    *,
    sets: Sets = None,
    speed: Speed = "600rpm",
    budget: str = option("60s", "Wall-clock time after which no trial begins; a bare number is in s."),
    by: str = option(
        "position", "Error that decides: position, velocity, acceleration, angle, loop or drive."
    ),
    outputs: Annotated[
        list[str] | None, table_or_plot_file("Table of all trials", "work-precision plot", (".csv",))
    ] = None,
) -> Result:
    """Measure how fast and how accurate MuJoCo's settings are on one mechanism, and recommend some.

    Examples:
    mechsim tradeoff slider_crank --budget 20s -o precision.svg
    mechsim tradeoff gripper.xml --by velocity
    """
    output, plot = one_of_each(outputs, (".csv",), PLOTS)
    if by not in COMPARED:
        raise InputError(f"there is no error by {by!r}; choose from {', '.join(COMPARED)}")
    seconds = units.parse_time(budget, "the budget")
    if not 0.0 < seconds < float("inf"):
        raise InputError(f"the budget is {budget}; give a time above 0, as in 60s")
    timer = Budget(seconds, exit_codes.typed_at)
    with progress("tradeoff", None) as report:
        solver = ModelOptions(model=model, sets=sets).load()
        stated.exclude(["speed"], "under motion laws", not solver.motion_laws.crank)
        subject = subject_of(solver, crank_speed(speed))
        result = measure_tradeoff(subject, budget=timer, progress=report)
    if output is not None:
        write_csv(output, result, by)
    if plot is not None:
        plots.write(plot, work_precision(result, by))
    data: dict[str, Any] = result.as_dict(by)
    for row in data["recommended"]:
        point = result.choice(row["limit"], by)
        row["command"] = None if point is None else command_of(point, model, subject)
    data |= {"budget": timer.seconds, "output": output, "plot": plot}

    def text() -> None:
        _print(result, by)
        _print_advice(result, by, model)

    return Result(data, text, files=[output, plot])


def _print(result: Tradeoff, by: str) -> None:
    """Print the cheapest setting for each limit, MuJoCo's defaults, and the errors of both."""
    subject = result.subject
    points = {f"{limit:.0e}": result.choice(limit, by) for limit in BOUNDS}
    for point in result.points:
        if point.method.name == DEFAULTS and point.settings.steps_per_turn in DEFAULTS_STEPS:
            points[f"(defaults, {point.settings.steps_per_turn})"] = point
    rows: list[tuple[Value, ...]] = []
    errors: list[tuple[Value, ...]] = []
    for name, point in points.items():
        if point is None:
            rows.append((name, "not reached", None, None))
            continue
        steps = str(point.settings.steps_per_turn)
        rows.append((name, point.method.name, steps, number(1e3 * point.cost, 3)))
        errors.append((name, *(f"{error:.1e}" for error in point.errors.values())))
    title = f"{subject.name} against {subject.solver.method}: cheapest settings by {by} error"
    period = "turn" if subject.solver.motion_laws.crank else "cycle"
    print_table(title, ("error within", "use", f"steps/{period}", f"ms/{period}"), rows)
    print_table("Errors of these settings", ("error within", *result.points[0].errors), errors)
    speed, cycle = "the crank speed", ""
    if period == "cycle":
        speed, seconds = "the angular frequency of a cycle", number(REVOLUTION / subject.speed)
        cycle = f"; a cycle of the fastest driver, or the whole motion, takes {seconds} s"
    print_text(
        f"position and loop in strokes, velocity and acceleration in strokes and {speed}, "
        f"angle and drive in rad; stroke {number(subject.stroke)} m{cycle}"
    )
    for name, curve in result.best_curves(by).items():
        if order := result.order(curve, by):
            print_text(f"{name}: order {order.order:.2f} ({order.low:.2f} to {order.high:.2f})")
    print_text(
        f"use: integrator, time constant of the loops (turn/10: a tenth of a {period}), compliance scale"
    )
    print_text(_count(result))


def _print_advice(result: Tradeoff, by: str, model: str) -> None:
    """Print the use of each recommendation; identical recommendations are printed once."""
    bounds_of: dict[str, list[str]] = {}
    for limit in BOUNDS:
        if point := result.choice(limit, by):
            bounds_of.setdefault(command_of(point, model, result.subject), []).append(f"{limit:.0e}")
    for text, bounds in bounds_of.items():
        typer.echo(f"{', '.join(bounds)}:")
        typer.echo(f"  {text}")


def _count(result: Tradeoff) -> str:
    """Return the number of measured settings, and the settings without a measurement with the reason."""
    items = [f"{several(len(result.points), 'setting')} measured in {number(result.seconds, 3)} s"]
    if result.left_out:
        items.append(f"{result.left_out} left out for lack of time")
    if result.untried:
        names = "; ".join(result.untried[:MAX_FAMILIES])
        rest = len(result.untried) - MAX_FAMILIES
        items.append(f"not tried: {names}{f' and {rest} more' if rest > 0 else ''}")
    return "; ".join(items)
