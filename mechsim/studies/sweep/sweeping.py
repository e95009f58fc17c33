"""One call from a subject and what varies of it to a table of measures."""

import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim import units
from mechsim.analytic.forms import Form
from mechsim.errors import InputError
from mechsim.maths.memory import require_room
from mechsim.model.mechanism import Mechanism
from mechsim.simulation.dynamics.prescribed_motion import HARD
from mechsim.simulation.settings import Settings
from mechsim.studies.sweep.chunks import bounds, run_parts
from mechsim.studies.sweep.designs import (
    Designs,
    declared_units,
    grid,
    listed,
    parameter_units,
    read_designs,
    sampled,
)
from mechsim.studies.sweep.identity import identity
from mechsim.studies.sweep.measures import measures
from mechsim.studies.sweep.parts import BESIDE, PartFolder, require_disk
from mechsim.studies.sweep.roads import require_measurable
from mechsim.studies.sweep.subject import OfPython, SweptSubject, swept
from mechsim.studies.sweep.table import (
    MARK,
    dataset,
    ending,
    read_sweep,
    require_libraries,
    write_sweep,
)
from mechsim.studies.sweep.task import BUILT, Measured, SweepTask, nothing_measured

if TYPE_CHECKING:
    from xarray import Dataset

# poses a turn
SAMPLES, MOST_SAMPLES = 72, 1_000_000
# bytes that a text takes in a table
TEXT = 16.0

Watch = Callable[[str, float], None]


def sweep(
    model: str | Form | Mechanism,
    vary: Mapping[str, Any] | None = None,
    measure: Sequence[str] | str = (),
    *,
    design: Mapping[str, Any] | str | None = None,
    sample: str | None = None,
    set: Mapping[str, str | float] | None = None,
    samples: int | None = None,
    speed: float | str = 1.0,
    settings: Settings | None = None,
    output: str | Path | None = None,
    resume: bool = False,
    scheduler: Any = None,
    watch: Watch = lambda _, __: None,
    **asked: Any,
) -> "Dataset":
    """Measure many designs of a mechanism.

    Args:
        model: as `load` takes it, or what moves itself.
        vary: parameter -> values in SI, of which all are taken with all others; with `sample` its lower and
            upper end.
        measure: such as "range:rocker", "max:P3.vx", "stroke:P3", "at:90deg:rocker", "crank_range",
            "FILE.py:FUNC" (see `measures.measure`).
        design: parameter -> values in SI, one for each design, or a CSV file of them; in place of `vary`.
        sample: "sobol:N", "halton:N", "latin:N" or "random:N".
        set: parameter -> its value where it does not vary, as `load` takes it.
        samples: poses a turn, or over the programs of drivers; None for 72.
        speed: of the crank in [rad/s], or text, as "600rpm".
        settings: how designs are stepped in MuJoCo, in place of motions by formulas and loop equations.
            Without a compliance, loops are as hard as what is measured asks for. Poses are then some of the
            steps, about 72 where `samples` does not say, and the steps of a turn are made a multiple of
            them; an automatic `jacobian` is dense, so that numbers are the same wherever they are made.
        output: .nc, .zarr, .parquet or .csv to write, part by part.
        resume: whether a sweep that was stopped is to go on.
        scheduler: of Dask: None for its own in this process, an address tcp://..., or a Client.
        watch: told how far it has come, in words and as a part of the whole, 0 to 1.
        asked: what else `load` takes.

    Returns:
        Measures over the parameters, with units, and for each design `outcome`, "met" where it was built,
        "swings" where it was and its crank does not turn fully, and `reason`. Of a crank that swings measures
        are over its reachable range; rates and forces over the middle 0.9 of it.

    Raises:
        InputError: for an unknown parameter or measure, more designs than memory or disk hold, or an output
            that holds another sweep.
        MissingToolError: where a library of `mechsim[sweep]` is not installed.
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
        settings=settings,
        **asked,
    )
    return run_sweep(task, output, resume=resume, scheduler=scheduler, watch=watch)


def swept_designs(
    model: str | Form | Mechanism | SweptSubject, set: Mapping[str, str | float] | None = None, **asked: Any
) -> tuple[SweptSubject, dict[str, str]]:
    """Return what is swept, and what may vary of it: parameter -> SI unit, empty where none is said."""
    subject = model if isinstance(model, SweptSubject) else swept(model, set, **asked)
    if isinstance(subject.make, OfPython):
        return subject, dict.fromkeys(subject.family.dimensions, "")
    return subject, parameter_units(subject.family, subject.form)


def swept_task(
    model: str | Form | Mechanism | SweptSubject,
    vary: Mapping[str, Any] | None,
    measure: Sequence[str] | str,
    *,
    design: Mapping[str, Any] | str | None = None,
    sample: str | None = None,
    set: Mapping[str, str | float] | None = None,
    samples: int | None = None,
    speed: float | str = 1.0,
    settings: Settings | None = None,
    **asked: Any,
) -> SweepTask:
    """Return a sweep, checked, as yet not begun; as `sweep`."""
    least = 1 if settings is None else 2
    if samples is None:
        steps = SAMPLES if settings is None else settings.steps_per_turn
        samples = -(-steps // max(1, steps // SAMPLES))
    if not least <= samples <= MOST_SAMPLES:
        raise InputError(f"{samples} samples a turn; give {least} to {MOST_SAMPLES:,}")
    subject, there = swept_designs(model, set, **asked)
    designs = _designs(subject, vary or {}, design, sample, there)
    rate = float(units.si(speed, "rad/s", "the speed"))
    texts = [measure] if isinstance(measure, str) else list(measure)
    asked_for = measures(texts, subject.form.mechanism, subject.form.programs)
    if settings is not None and settings.jacobian == "auto":
        settings = replace(settings, jacobian="dense")
    task = _hard_enough(SweepTask(subject, designs, asked_for, int(samples), rate, settings))
    require_measurable(task)
    return task


def _hard_enough(task: SweepTask) -> SweepTask:
    """Return a sweep that reads forces of designs stepped by themselves off loops as hard as `dynamics` has.

    Where designs are stepped together the loops stay as hard as places need: harder ones left 2e-5 of the
    torque of a Bennett linkage, whose rows are redundant, and made no other better.
    """
    settings = task.settings
    if settings is None or settings.compliance is not None or not task.loaded or task.like is not None:
        return task
    return replace(task, settings=replace(settings, compliance=HARD.compliance))


def _designs(
    subject: SweptSubject,
    vary: Mapping[str, Any],
    design: Mapping[str, Any] | str | None,
    sample: str | None,
    there: Mapping[str, str],
) -> Designs:
    name = subject.name
    if design is not None and (vary or sample is not None):
        raise InputError("designs are given and ranges too; give one of them")
    if isinstance(design, str):
        return read_designs(design, name, there, declared_units(subject.family))
    if design is not None:
        return listed(design, name, there, "list of designs")
    return grid(vary, name, there) if sample is None else sampled(sample, vary, name, there)


def run_sweep(
    task: SweepTask,
    output: str | Path | None = None,
    *,
    resume: bool = False,
    scheduler: Any = None,
    watch: Watch = lambda _, __: None,
) -> "Dataset":
    """Measure all designs of a sweep; write them where that is asked for; as `sweep`."""
    count, each = task.designs.count, 8.0 * (len(task.measures) + 1) + TEXT
    # while a table is put together it is there twice
    require_room(f"{count:,} designs", count, 2.0 * each + BESIDE, "{most} fit: take fewer")
    mark = identity(task)
    place = None if output is None else Path(output)
    if place is not None:
        ending(place)
        require_disk(place, count, each)
        if _done(place, mark, resume):
            return read_sweep(place)
    parts = bounds(task)
    folder = None if place is None else PartFolder(place, mark, len(parts))
    done = {} if folder is None else folder.begin(resume=resume)
    whole = nothing_measured(task, count)
    ended, lock = len(done), threading.Lock()

    def keep(number: int, found: Measured) -> None:
        nonlocal ended
        if folder is not None:
            folder.write(number, found)
        _put(whole, parts[number], found.values.values(), found.outcome, found.reason)
        with lock:
            ended += 1
            watch(f"{parts[number][1] - parts[number][0]:,} designs", ended / len(parts))

    for number in done:
        assert folder is not None
        _put(whole, parts[number], *folder.read(number))
    left = [(i, *ends) for i, ends in enumerate(parts) if i not in done]
    try:
        if left:
            run_parts(task, left, keep, scheduler)
    except InputError:
        if folder is not None and not ended:
            # what could not be begun leaves nothing behind
            folder.remove()
        raise
    found = dataset(task, whole.values, whole.outcome, whole.reason, {MARK: mark})
    if place is not None and folder is not None:
        write_sweep(place, found)
        folder.remove()
    return found


def _put(whole: Measured, ends: tuple[int, int], values: Any, outcome: Any, reason: Any) -> None:
    rows = slice(*ends)
    for column, some in zip(whole.values.values(), values, strict=True):
        column[rows] = some
    whole.outcome[rows] = outcome
    whole.reason[rows] = reason


def _done(place: Path, mark: str, resume: bool) -> bool:
    """Whether an output is there and is this sweep's, which is to go on; refuse one of another sweep."""
    if not place.exists():
        return False
    held = ""
    if ending(place) != ".csv":
        try:
            held = str(read_sweep(place).attrs.get(MARK, ""))
        except InputError:
            held = ""
    if held != mark:
        raise InputError(
            f"{place} is there already and holds another sweep; name another output, or remove it first"
        )
    return resume


def built(found: "Dataset") -> int:
    """Return how many designs of a sweep could be built, those whose cranks swing included."""
    return int(np.count_nonzero(np.isin(found["outcome"].values.astype(str), BUILT)))
