"""Command `mechsim sweep`: measures of many designs of one mechanism."""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from mechsim.cli.command import Result, Stated, Without, command, output_file
from mechsim.cli.load_options import masses_in_json, note_replaced, print_masses
from mechsim.cli.options import ModelOptions, Speed
from mechsim.cli.output import Value, number, print_table, print_text
from mechsim.cli.progress import progress
from mechsim.errors import InputError, require_once
from mechsim.mechanism.masses import masses_of, with_inertia
from mechsim.studies.sweep.designs import declared_units, parsed_range
from mechsim.studies.sweep.sweeping import built, run_sweep, swept_designs, swept_task
from mechsim.studies.sweep.table import SUFFIXES, design_columns, require_libraries
from mechsim.studies.sweep.task import BUILT, SweptSubject
from mechsim.units import crank_speed, option

if TYPE_CHECKING:
    from xarray import Dataset

# maximum number of printed reasons for failed designs
MAX_REASONS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepOptions:
    """Designs of a sweep, their measures, and how they are evaluated."""

    vary: tuple[str, ...] = option(
        (),
        "Vary a parameter over N values (crank=12mm:15mm:31), a list (branch=1,-1), or with --sample over a "
        "range P=A:B.",
        read=str,
        many=True,
        metavar="P=A:B:N",
    )
    design: str | None = option(
        None, "Table of designs: one row each, one column for each parameter.", metavar="FILE.csv"
    )
    sample: str | None = option(None, "Spread N designs over the ranges, as Sobol points.", metavar="sobol:N")
    measure: tuple[str, ...] = option(
        (),
        "Measure range:J, stroke:P, max|min|rms|mean|ripple:QUANTITY, at:ANGLE:QUANTITY "
        "(at:TIME:QUANTITY under motion laws), or FILE.py:FUNC of a Motion, which is code and is run. "
        "Quantities are J, J.v, J.a, P.x, P.vx, P.ax, speed:P, acceleration:P, distance:P,Q, "
        "angle:LINK,LINK, expr:EXPRESSION, torque, force:J, moment:J, transmission.",
        read=str,
        many=True,
        metavar="M",
    )
    samples: int | None = option(None, "Configurations in a turn, or over the motion laws. [default: 72]")
    speed: Speed = "600rpm"


@command
def sweep(
    source: Annotated[ModelOptions, Without("track", "loops")],
    output: Annotated[str, output_file("Table to write: .nc or .csv.", *SUFFIXES)],
    options: SweepOptions,
    *,
    stated: Stated,
) -> Result:
    """Measure many designs of a mechanism; write a table.

    Examples:
    mechsim sweep four_bar --vary crank=3cm:5cm:9 --measure range:rocker -o s.csv
    mechsim sweep rssr --vary crank=9mm:14mm --sample sobol:9 -o s.nc
    """
    start = time.perf_counter()
    require_libraries(output)
    subject, dimensions = swept_designs(source.model, **source.load_arguments())
    ranges = _ranges(options, subject, dimensions)
    if twice := sorted({*ranges} & {*source.parameters}):
        raise InputError(f"--set {twice[0]} has no effect, since --vary varies it; leave it out")
    task = swept_task(
        subject,
        ranges,
        options.measure,
        design=options.design,
        sample=options.sample,
        samples=options.samples,
        speed=crank_speed(options.speed),
    )
    if task.measures.loaded:
        note_replaced(subject.solver)
    moving = task.measures.rated or task.measures.loaded or task.measures.includes("function")
    stated.exclude(["speed"], "on measures of positions", not moving)
    with progress("sweep", None) as report:
        result = run_sweep(task, output, progress=report)
    seconds = time.perf_counter() - start
    masses = masses_of(with_inertia(task.subject.solver.mechanism)) if task.measures.loaded else ()
    data: dict[str, Any] = {"model": source.model, "output": output, "designs": task.designs.count}
    data |= {"built": built(result), "seconds": seconds} | masses_in_json(masses)

    def text() -> None:
        _print(result, f"{built(result):,} of {task.designs.count:,} designs built, {number(seconds, 3)} s")
        typer.echo(f"wrote {output}")
        print_masses(masses, design="of the original design")

    return Result(data, text, built(result) > 0)


def _ranges(options: SweepOptions, subject: SweptSubject, dimensions: Mapping[str, str]) -> dict[str, Any]:
    declared, sampled = declared_units(subject.design_family), options.sample is not None
    ranges = [
        parsed_range(text, subject.name, dimensions, sampled=sampled, declared=declared)
        for text in options.vary
    ]
    require_once("--vary", [parameter for parameter, _ in ranges])
    return dict(ranges)


def _print(result: "Dataset", title: str) -> None:
    """Print minimum and maximum of each measure with their designs, and the reasons for failures."""
    table = design_columns(result)
    valid = np.isin(table["outcome"].astype(str), BUILT)
    parameters = [str(name) for name in result.coords]
    measures = [name for name in table if name not in ("outcome", "reason", *parameters)]
    rows: list[tuple[Value, ...]] = []
    for name in measures if valid.any() else ():
        values, unit = table[name], result[name].attrs.get("units", "1")
        for which, best in (("lowest", np.argmin), ("highest", np.argmax)):
            i = int(np.flatnonzero(valid)[best(values[valid])])
            design = [f"{parameter} = {number(float(table[parameter][i]))}" for parameter in parameters]
            rows.append((name, which, float(values[i]), unit, ", ".join(design)))
    typer.echo(title if valid.any() else f"FAILED: no design can be measured; {title}")
    print_table("", ("measure", "", "value", "unit", "at"), rows)
    if swings := int(np.count_nonzero(table["outcome"].astype(str) == "swings")):
        typer.echo(f"{swings:,} of them swing: they are measured over their reachable ranges")
    reasons, counts = np.unique(table["reason"][~valid].astype(str), return_counts=True)
    for i in np.argsort(-counts)[:MAX_REASONS]:
        print_text(f"{counts[i]:,} not built: {reasons[i]}")
