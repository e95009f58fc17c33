"""Command `mechsim trace`: every assembly of a mechanism as closed curves, as tables and as plain data."""

import math
from typing import Annotated, Any

import numpy as np

from mechsim import files
from mechsim.cli.command import Result, Without, command, table_file
from mechsim.cli.options import ModelOptions
from mechsim.cli.output import Value, number, print_table, print_text
from mechsim.cli.progress import progress
from mechsim.errors import several
from mechsim.mechanism.limits import Ranges
from mechsim.mechanism.links import VIRTUAL_PREFIX
from mechsim.numerics.arrays import Array
from mechsim.studies.trace import STARTS, AssemblyTrace
from mechsim.studies.trace import trace as trace_assemblies
from mechsim.units import option

# significant digits of angles and lengths that describe a curve
CURVE_DIGITS = 4


@command
def trace(
    source: Annotated[ModelOptions, Without("duration", "track", "loops")],
    output: Annotated[str | None, table_file("Table of the curves")] = None,
    starts: int = option(STARTS, "Random starts of the search for assemblies."),
) -> Result:
    """Trace all assemblies of a mechanism with one DOF as closed curves, past every dead centre.

    A curve holds the poses that are reached without a jump. The result lists the extreme values of joint
    coordinates, the dead centres of the crank, and where curves meet. Locked joints stay locked; drivers are
    released; limits of joints do not end a curve. One that is unbounded along a slide or a screw, or longer
    than 3,000 segments, is an error.
    The table has the columns component, arc, angle of the crank, J.q of joints and P.x, P.y, P.z of points.

    Examples:
    mechsim trace four_bar --set crank=90mm
    mechsim trace rssr -o curves.csv
    """
    source.require_other_drivers()
    solver = source.load()
    with progress("trace", None, at_least=True) as report:
        curves = trace_assemblies(solver.mechanism, starts=starts, progress=report)
    if output is not None:
        files.write_table(output, curve_table(curves))
    data: dict[str, Any] = {**trace_record(curves), "output": output}
    return Result(data, lambda: _print(curves, solver.ranges), files=[output])


def _print(trace: AssemblyTrace, ranges: Ranges) -> None:
    first = trace.curves[0]
    driver = "crank" if first.driver.unit == "rad" else first.driver.coordinate
    rows: list[tuple[Value, ...]] = []
    for i, curve in enumerate(trace.curves, 1):
        dead_centres = ", ".join(_quantity(float(angle), curve.driver.unit) for angle in curve.dead_centres)
        turns = several(abs(curve.turns), "turn") if curve.turns else ""
        moves = turns or ("swings" if dead_centres else "stands still")
        name = f"{i}{' (initial)' if i == 1 else ''}"
        rows.append((name, curve.starts_ended, curve.length, moves, dead_centres))
    title = (
        f"{trace.mechanism.name}: {several(len(trace.curves), 'component')}; {trace.closed} of "
        f"{trace.starts} random starts (seed {trace.seed}) ended in an assembly"
    )
    print_table(title, ("component", "starts", "arc", driver, "dead centres"), rows)
    units = {column.name: column.unit for column in first.joints.columns}
    points = [(str(i), point) for i, curve in enumerate(trace.curves, 1) for point in curve.turning_points]
    rows = [
        (
            component,
            point.coordinate,
            point.which,
            _quantity(point.value, units[point.coordinate]),
            point.arc,
            _quantity(point.angle, first.driver.unit),
        )
        for component, point in points
        if not point.coordinate.startswith(VIRTUAL_PREFIX)
    ]
    head = ("component", "coordinate", "", "value", "arc", driver)
    print_table("Extreme values of coordinates", head, rows)
    for point in trace.branch_points:
        locations = ", ".join(f"{i + 1} at arc {number(arc)}" for i, arc in point.locations)
        angle = _quantity(point.angle, first.driver.unit)
        print_text(f"assemblies meet at {driver} {angle}: component {locations}")
    for line in trace.left_out:
        print_text(line)
    extremes = [(point.coordinate.removesuffix(".q"), point.value) for _, point in points]
    exceeded = {
        name for name, value in extremes if name in ranges and not ranges[name][0] <= value <= ranges[name][1]
    }
    if exceeded:
        names = ", ".join(sorted(exceeded))
        print_text(f"the curves continue beyond the limits of {names}, which solve and show keep")
    if trace.complete_at:
        where = f"at {trace.complete_at} positions of {driver}"
        print_text(f"complete: every assembly of the Assur groups {where} is on a component")
    else:
        reason = trace.reason or "some poses of groups do not close"
        print_text(f"perhaps more: found from random starts; {reason}")


def _quantity(value: float, unit: str) -> str:
    if unit == "m":
        return f"{number(value * 1e3, CURVE_DIGITS)} mm"
    return f"{number(round(math.degrees(value), 6), CURVE_DIGITS)} deg"


# number of rows of a curve in a table
SAMPLES = 361


def curve_table(trace: AssemblyTrace) -> dict[str, Array]:
    """Return all curves one after another, at evenly spaced arc lengths with both ends.

    The column `component` numbers them from 1.
    """
    tables = [dict(curve.samples(SAMPLES).columns()) for curve in trace.curves]
    counted = [np.full(len(table["arc"]), i + 1.0) for i, table in enumerate(tables)]
    columns = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    return {"component": np.concatenate(counted), **columns}


def trace_record(trace: AssemblyTrace) -> dict[str, Any]:
    """Return the trace as plain data; components are counted from 1."""
    facts = ("starts_ended", "length", "turns", "dead_centres", "turning_points")
    return {
        "mechanism": trace.mechanism.name,
        **files.attributes(trace, "starts", "seed", "closed", "left_out", "complete_at", "reason"),
        "components": [
            {"component": i, "own": i == 1, **files.attributes(curve, *facts)}
            for i, curve in enumerate(trace.curves, 1)
        ],
        "branch_points": [
            {
                "angle": point.angle,
                "places": [{"component": i + 1, "arc": arc} for i, arc in point.locations],
            }
            for point in trace.branch_points
        ],
    }
