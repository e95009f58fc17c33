"""Sweeps: from a subject and its varied parameters to a table of measures."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim import units
from mechsim.errors import InputError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.quantity import TRANSMISSION
from mechsim.numerics.resources import Progress, no_progress, require_memory
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.studies.sweep import designs
from mechsim.studies.sweep.measures import measures
from mechsim.studies.sweep.methods import by_one_formula, measured_designs
from mechsim.studies.sweep.table import dataset, require_libraries, suffix_of, write_sweep
from mechsim.studies.sweep.task import BUILT, SweepTask, SweptSubject, swept_subject

if TYPE_CHECKING:
    from xarray import Dataset

# default and largest number of poses of a motion
SAMPLES, MAX_SAMPLES = 72, 1_000_000
# bytes of a text cell in a table
BYTES_PER_TEXT = 16.0


def sweep(
    model: str | KinematicSolver | Mechanism,
    vary: Mapping[str, Any] | None = None,
    measure: Sequence[str] | str = (),
    *,
    design: Mapping[str, Any] | str | None = None,
    sample: str | None = None,
    set: Mapping[str, str | float] | None = None,
    samples: int | None = None,
    speed: float | str = 1.0,
    output: str | Path | None = None,
    progress: Progress = no_progress,
    **options: Any,
) -> Dataset:
    """Measure many designs of a mechanism.

    Args:
        model: as for `load`, or a solver.
        vary: parameter -> values in SI, combined as a grid; with `sample` its lower and upper end.
        measure: such as "range:rocker", "max:P3.vx", "stroke:P3", "at:90deg:rocker", "FILE.py:FUNC"
            (see `measures.measure`).
        design: parameter -> values in SI, one for each design, or a CSV file of them; in place of `vary`.
        sample: "sobol:N", N Sobol points over the ranges.
        set: parameter -> its value if it does not vary, as for `load`.
        samples: number of poses in a revolution, or over the motion laws of drivers; None for 72.
        speed: crank speed in [rad/s], or text, as "600rpm".
        output: .nc or .csv to write.
        progress: called with a description and the finished fraction, 0 to 1.
        options: further arguments of `load`.

    Returns:
        Measures over the parameters, with units, and for each design `reason` and `outcome`: "passed" if it
        was built, "swings" if its crank does not turn fully. Measures of a swinging crank cover its reachable
        range; rates and forces cover the middle 0.9 of it.

    Raises:
        InputError: for an unknown parameter or measure, or more designs than fit into memory.
        MissingToolError: if a library of `mechsim[sweep]` is not installed.
    """
    require_libraries(output)
    task = swept_task(
        model,
        vary,
        measure,
        design=design,
        sample=sample,
        set=set,
        samples=samples,
        speed=speed,
        **options,
    )
    return run_sweep(task, output, progress=progress)


def swept_designs(
    model: str | KinematicSolver | Mechanism | SweptSubject,
    set: Mapping[str, str | float] | None = None,
    **options: Any,
) -> tuple[SweptSubject, dict[str, str]]:
    """Return the subject and its variable parameters: parameter -> SI unit, empty if none is declared."""
    subject = model if isinstance(model, SweptSubject) else swept_subject(model, set, **options)
    if subject.unitless:
        return subject, dict.fromkeys(subject.design_family.dimensions, "")
    return subject, designs.parameter_units(subject.design_family, subject.solver)


def swept_task(
    model: str | KinematicSolver | Mechanism | SweptSubject,
    vary: Mapping[str, Any] | None,
    measure: Sequence[str] | str,
    *,
    design: Mapping[str, Any] | str | None = None,
    sample: str | None = None,
    set: Mapping[str, str | float] | None = None,
    samples: int | None = None,
    speed: float | str = 1.0,
    **options: Any,
) -> SweepTask:
    """Return a checked sweep that has not started; arguments as for `sweep`."""
    samples = SAMPLES if samples is None else samples
    if not 1 <= samples <= MAX_SAMPLES:
        raise InputError(f"{samples} poses in a motion; give 1 to {MAX_SAMPLES:,}")
    texts = [measure] if isinstance(measure, str) else list(measure)
    subject, parameters = swept_designs(model, set, **options)
    vary, name, solver = vary or {}, subject.name, subject.solver
    if design is not None and (vary or sample is not None):
        raise InputError("both designs and ranges are given; give only one")
    if isinstance(design, str):
        swept = designs.read_designs(design, name, parameters, designs.declared_units(subject.design_family))
    elif design is not None:
        swept = designs.listed_designs(design, name, parameters, "list of designs")
    elif sample is None:
        swept = designs.grid_designs(vary, name, parameters)
    else:
        swept = designs.sampled_designs(sample, vary, name, parameters)
    rate = float(units.si(speed, "rad/s", "the speed"))
    measures_read = measures(texts, solver.mechanism, solver.motion_laws)
    if measures_read.includes(TRANSMISSION):
        # reject a mechanism whose designs have none
        solver.required_transmission_angle([solver.mechanism.start])
    solver.motion_laws.require_drivers(solver.mechanism)
    return SweepTask(subject, swept, measures_read, int(samples), rate)


# designs in a chunk: by one formula, by loop equations together, and one at a time
BY_FORMULA, BY_LOOPS, SINGLE = 8192, 256, 64
# largest number of chunks in a sweep: more designs make longer chunks
MAX_CHUNKS = 20_000


def run_sweep(
    task: SweepTask,
    output: str | Path | None = None,
    *,
    progress: Progress = no_progress,
) -> Dataset:
    """Measure all designs of a sweep and write them to the output, if any; as `sweep`."""
    count, each = task.designs.count, 8.0 * (len(task.measures) + 1) + BYTES_PER_TEXT
    # a table is in memory twice while it is built
    require_memory(f"{count:,} designs", count, 2.0 * each, "{most} fit: reduce the number")
    if output is not None:
        suffix_of(output)
    usual = BY_FORMULA if by_one_formula(task) else SINGLE if task.loops is None else BY_LOOPS
    length = max(usual, -(-count // MAX_CHUNKS))
    chunks = [(low, min(low + length, count)) for low in range(0, count, length)]
    table = task.unmeasured(count)
    pool = ThreadPoolExecutor(os.cpu_count())
    try:
        # before threads start: each thread would restore the state that it finds
        with quiet():
            for (low, high), result in zip(
                chunks, pool.map(lambda chunk: measured_designs(task, *chunk), chunks), strict=True
            ):
                for name, values in result.values.items():
                    table.values[name][low:high] = values
                table.outcome[low:high], table.reason[low:high] = result.outcome, result.reason
                progress(f"{high:,} of {count:,} designs", high / count)
    finally:
        pool.shutdown(cancel_futures=True)
    swept = dataset(task, table.values, table.outcome, table.reason)
    if output is not None:
        write_sweep(output, swept)
    return swept


def built(result: Dataset) -> int:
    """Return the number of built designs in a sweep, including those whose cranks swing."""
    return int(np.count_nonzero(np.isin(result["outcome"].values.astype(str), BUILT)))
