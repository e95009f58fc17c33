"""Command `mechsim sweep`: many designs of one mechanism, measured."""

import time
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from mechsim.cli.declared_options import spread
from mechsim.cli.options import DriveOptions, File, Json, Model, Sets, Speed, pair_of, speed_of
from mechsim.cli.output import print_json, print_table, progress
from mechsim.errors import InputError, OutputError
from mechsim.files import place_of
from mechsim.studies.sweep.checking import CheckedDesigns, check_table
from mechsim.studies.sweep.designs import parsed_range
from mechsim.studies.sweep.sweeping import SAMPLES, built, run_sweep, swept_designs, swept_task
from mechsim.studies.sweep.table import TEXTS, columns, ending, read_sweep, require_libraries

if TYPE_CHECKING:
    from xarray import Dataset

# reasons that are printed
MOST_REASONS = 5


@spread
def sweep(
    model: Model,
    output: File,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="P=A:B:N", help="Vary a parameter: crank=12mm:15mm:31; branch=1,-1; with --sample P=A:B."
        ),
    ] = None,
    design: Annotated[
        str | None,
        typer.Option(metavar="FILE.csv", help="Designs instead, one a row: a column a parameter."),
    ] = None,
    sample: Annotated[
        str | None,
        typer.Option(
            metavar="sobol:N", help="Spread N designs over the ranges: sobol, halton, latin, random."
        ),
    ] = None,
    measure: Annotated[
        list[str] | None,
        typer.Option(
            metavar="M",
            help="range:J, stroke:P, max|min|rms|mean:QUANTITY, at:ANGLE:QUANTITY, crank_range, "
            "dead_centres, assemblies, FILE.py:FUNC of a Motion; quantities are J, J.v, J.a, P.x, P.vx, "
            "P.ax, speed:P, acceleration:P, torque, force:J, moment:J, transmission.",
        ),
    ] = None,
    samples: Annotated[int, typer.Option(help="Poses a turn, or over the programs.")] = SAMPLES,
    speed: Speed = "600rpm",
    check: Annotated[
        int,
        typer.Option(metavar="N", help="Judge N random designs by MuJoCo's poses, too."),
    ] = 0,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with a sweep that was stopped.")] = False,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="tcp://HOST:PORT", help="Of a Dask cluster; without it, this process by threads."
        ),
    ] = None,
    *,
    driven: DriveOptions,
    sets: Sets = None,
    as_json: Json = False,
) -> None:
    """Measure many designs of a mechanism; write .nc, .zarr, .parquet or .csv, part by part."""
    begun = time.perf_counter()
    require_writable(output)
    require_libraries(output)
    changed = {name: value or "" for name, value in map(pair_of("--set", "--set crank=13mm"), sets or ())}
    asked: dict[str, Any] = {
        "drive": dict(driven.drive),
        "hold": dict(driven.hold),
        "hold_base": driven.hold_base,
        "key": driven.key,
        "track": driven.track,
        "duration": driven.duration,
    }
    subject, there = swept_designs(model, changed, **asked)
    ranges: dict[str, Any] = {}
    for text in vary or ():
        name, values = parsed_range(text, subject.name, there, sampled=sample is not None)
        if name in ranges:
            raise InputError(f"--vary names {name} twice; give it once")
        ranges[name] = values
    task = swept_task(
        subject, ranges, measure or (), design=design, sample=sample, samples=samples, speed=speed_of(speed)
    )
    with progress("sweep", None, quiet=as_json) as tick:
        found = run_sweep(task, output, resume=resume, scheduler=scheduler, watch=tick)
    seconds = time.perf_counter() - begun
    told: dict[str, Any] = {
        "model": model,
        "output": output,
        "designs": task.designs.count,
        "built": built(found),
    }
    checked = check_table(task, found, check) if check > 0 else None
    if checked is not None:
        told["checked"] = {"designs": checked.count, "passed": checked.passed, "worst": checked.worst}
    if as_json:
        print_json({**told, "seconds": seconds})
        raise typer.Exit(_code(checked))
    _print(found, f"{told['built']:,} of {task.designs.count:,} designs built, {seconds:.3g} s")
    typer.echo(f"wrote {output}")
    if checked is not None:
        typer.echo(
            f"{checked.passed} of {checked.count} designs agree with MuJoCo's poses; the farthest point is "
            f"{checked.worst:.3g} m off"
        )
        for number, why in checked.failed.items():
            typer.echo(f"MISSED: design {number}: {why}")
    raise typer.Exit(_code(checked))


def _code(checked: CheckedDesigns | None) -> int:
    return 0 if checked is None or checked.passed == checked.count else 1


def require_writable(output: str) -> None:
    """Refuse an output whose folder is not there, before any work is done for it.

    Raises:
        InputError: for an ending that is not known.
        OutputError: for no such folder.
    """
    ending(output)
    if not output.lower().endswith(".zarr"):
        place_of(output)
    from pathlib import Path

    if not Path(output).parent.is_dir():
        raise OutputError(
            f"cannot write {output!r}: there is no folder {str(Path(output).parent)!r}; make it first"
        )


def drawn_sweep(path: str, of: tuple[str, ...] | None, kind: str | None) -> Any:
    """Return a sweep that was written as a figure."""
    from mechsim.pictures.plots.sweep import SweepTable, sweep_plot

    found = read_sweep(path)
    table = columns(found)
    given = [str(name) for name in found.coords]
    measured = [name for name in table if name not in (*given, *TEXTS)]
    numbers = {name: table[name] for name in measured}
    said = {str(name): str(one.attrs.get("units", "1")) for name, one in found.variables.items()}
    title = str(found.attrs.get("model", path))
    parameters = {name: table[name] for name in given}
    return sweep_plot(SweepTable(title, parameters, numbers, said, found["outcome"].shape), of, kind)


def _print(found: "Dataset", title: str) -> None:
    table, rows = columns(found), []
    good = table["outcome"] == "met"
    given = [str(name) for name in found.coords]
    for name, values in table.items():
        if name in ("outcome", "reason") or name in given or not good.any():
            continue
        low, high = (int(np.flatnonzero(good)[one(values[good])]) for one in (np.argmin, np.argmax))
        unit = found[name].attrs.get("units", "1")
        at = [", ".join(f"{p} = {float(table[p][i]):.5g}" for p in given) for i in (low, high)]
        rows.append((name, unit, f"{values[low]:.6g}", at[0], f"{values[high]:.6g}", at[1]))
    print_table(title, ("measure", "unit", "lowest", "at", "highest", "at"), rows)
    reasons, counts = np.unique(table["reason"][~good].astype(str), return_counts=True)
    for i in np.argsort(-counts)[:MOST_REASONS]:
        typer.echo(f"{counts[i]:,} not built: {reasons[i]}")
