"""Command `mechsim sweep`: many designs of one mechanism, measured."""

import time
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from mechsim.cli.declared_options import spread
from mechsim.cli.load_options import print_masses
from mechsim.cli.options import DriveOptions, File, Json, Model, Sets, Speed, changed_by, moved_by, speed_of
from mechsim.cli.output import print_json, print_table
from mechsim.cli.progress import progress
from mechsim.errors import InputError, OutputError
from mechsim.files import resolved_path
from mechsim.model.masses import masses_of, with_inertia
from mechsim.simulation.settings import Settings
from mechsim.studies.sweep.designs import declared_units, parsed_range
from mechsim.studies.sweep.subject import SweptSubject
from mechsim.studies.sweep.sweeping import (
    CheckedDesigns,
    built,
    check_table,
    run_sweep,
    swept_designs,
    swept_task,
)
from mechsim.studies.sweep.table import columns, require_libraries, suffix_of
from mechsim.studies.sweep.task import BUILT, SweepTask

if TYPE_CHECKING:
    from xarray import Dataset

# reasons that are printed
MOST_REASONS = 5


Vary = Annotated[
    list[str] | None,
    typer.Option(
        metavar="P=A:B:N", help="Vary a parameter: crank=12mm:15mm:31; branch=1,-1; with --sample P=A:B."
    ),
]
Design = Annotated[
    str | None,
    typer.Option(metavar="FILE.csv", help="Designs instead, one a row: a column a parameter."),
]
Sample = Annotated[
    str | None,
    typer.Option(metavar="sobol:N", help="Spread N designs over the ranges: sobol, halton, latin, random."),
]
Measure = Annotated[
    list[str] | None,
    typer.Option(
        metavar="M",
        help="range:J, stroke:P, max|min|rms|mean|ripple:QUANTITY, at:ANGLE:QUANTITY "
        "(at:TIME:QUANTITY under motion laws), crank_range, "
        "dead_centres, assemblies, FILE.py:FUNC of a Motion; quantities are J, J.v, J.a, P.x, P.vx, "
        "P.ax, speed:P, acceleration:P, torque, force:J, moment:J, transmission.",
    ),
]
Samples = Annotated[
    int | None, typer.Option(help="Poses a turn, or over the programs; 72, when stepped about so many.")
]
Method = Annotated[
    str | None,
    typer.Option(
        metavar="step",
        help="step integrates every design in MuJoCo; so does an integrator or a constraint setting. By "
        "default formulas and loop equations.",
    ),
]
Check = Annotated[
    int,
    typer.Option(metavar="N", help="Judge N random designs by the other road, too."),
]
Resume = Annotated[bool, typer.Option("--resume", help="Go on with a sweep that was stopped.")]
Scheduler = Annotated[
    str | None,
    typer.Option(metavar="tcp://HOST:PORT", help="Of a Dask cluster; without it, this process by threads."),
]


@spread
def sweep(
    model: Model,
    output: File,
    *,
    vary: Vary = None,
    design: Design = None,
    sample: Sample = None,
    measure: Measure = None,
    samples: Samples = None,
    speed: Speed = "600rpm",
    method: Method = None,
    asked: Annotated[Mapping[str, Any], Settings],
    check: Check = 0,
    resume: Resume = False,
    scheduler: Scheduler = None,
    driven: DriveOptions,
    sets: Sets = None,
    as_json: Json = False,
) -> None:
    """Measure many designs of a mechanism; write .nc, .zarr, .parquet or .csv, part by part."""
    begun = time.perf_counter()
    require_writable(output)
    require_libraries(output)
    subject, there = swept_designs(model, changed_by(sets), **moved_by(driven))
    task = swept_task(
        subject,
        _ranges(vary or (), subject, there, sampled=sample is not None),
        measure or (),
        design=design,
        sample=sample,
        samples=samples,
        speed=speed_of(speed),
        settings=_settings(method, asked),
    )
    with progress("sweep", None, quiet=as_json) as tick:
        found = run_sweep(task, output, resume=resume, scheduler=scheduler, progress=tick)
    seconds = time.perf_counter() - begun
    checked = check_table(task, found, check) if check > 0 else None
    masses = masses_of(with_inertia(task.subject.solver.mechanism)) if task.loaded else ()
    if as_json:
        used = {"masses": [one.as_dict() for one in masses]} if masses else {}
        print_json(_told(model, output, task, found, checked) | {"seconds": seconds} | used)
    else:
        _print(found, f"{built(found):,} of {task.designs.count:,} designs built, {seconds:.3g} s")
        typer.echo(f"wrote {output}")
        _print_checked(checked)
        print_masses(masses, of="of the design as it stands")
    raise typer.Exit(0 if checked is None or checked.passed == checked.count else 1)


def _ranges(
    vary: Sequence[str], subject: SweptSubject, there: Mapping[str, str], *, sampled: bool
) -> dict[str, Any]:
    declared = declared_units(subject.design_family)
    ranges: dict[str, Any] = {}
    for text in vary:
        parameter, values = parsed_range(text, subject.name, there, sampled=sampled, declared=declared)
        if parameter in ranges:
            raise InputError(f"--vary names {parameter} twice; give it once")
        ranges[parameter] = values
    return ranges


def _settings(method: str | None, asked: Mapping[str, Any]) -> Settings | None:
    """Return how designs are stepped; None where they are not: as `simulate` it steps where that is asked."""
    if method not in (None, "step"):
        raise InputError(f"there is no method {method!r} of a sweep; known is step, formulas without it")
    return Settings(**asked) if method == "step" or asked else None


def _told(
    model: str, output: str, task: SweepTask, found: "Dataset", checked: CheckedDesigns | None
) -> dict[str, Any]:
    """Return what is printed as JSON, but for the time it took."""
    told = {"model": model, "output": output, "designs": task.designs.count, "built": built(found)}
    if checked is None:
        return told
    return told | {"checked": {"designs": checked.count, "passed": checked.passed, "worst": checked.worst}}


def require_writable(output: str) -> None:
    """Refuse an output whose folder is not there, before any work is done for it.

    Raises:
        InputError: for an ending that is not known.
        OutputError: for no such folder.
    """
    suffix_of(output)
    if not output.lower().endswith(".zarr"):
        resolved_path(output)
    from pathlib import Path

    if not Path(output).parent.is_dir():
        raise OutputError(
            f"cannot write {output!r}: there is no folder {str(Path(output).parent)!r}; make it first"
        )


def _print_checked(checked: CheckedDesigns | None) -> None:
    if checked is None:
        return
    typer.echo(
        f"{checked.passed} of {checked.count} designs agree with {checked.method}; the farthest point is "
        f"{checked.worst:.3g} m off"
    )
    for number, why in checked.failed.items():
        typer.echo(f"FAILED: design {number}: {why}")


def _print(found: "Dataset", title: str) -> None:
    table, rows = columns(found), []
    good = np.isin(table["outcome"].astype(str), BUILT)
    given = [str(name) for name in found.coords]
    for name, values in table.items():
        if name in ("outcome", "reason") or name in given or not good.any():
            continue
        low, high = (int(np.flatnonzero(good)[one(values[good])]) for one in (np.argmin, np.argmax))
        unit = found[name].attrs.get("units", "1")
        at = [", ".join(f"{p} = {float(table[p][i]):.5g}" for p in given) for i in (low, high)]
        rows.append((name, unit, f"{values[low]:.6g}", at[0], f"{values[high]:.6g}", at[1]))
    print_table(title, ("measure", "unit", "lowest", "at", "highest", "at"), rows)
    if swings := int(np.count_nonzero(table["outcome"].astype(str) == "swings")):
        typer.echo(f"{swings:,} of them swing: they are measured over their reachable ranges")
    reasons, counts = np.unique(table["reason"][~good].astype(str), return_counts=True)
    for i in np.argsort(-counts)[:MOST_REASONS]:
        typer.echo(f"{counts[i]:,} not built: {reasons[i]}")
