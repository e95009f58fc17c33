"""Measures of designs that are released from an initial state."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mechsim.analytic.dynamics import dynamic_model, nearest_equilibrium
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import AssemblyError
from mechsim.numerics.arrays import Array
from mechsim.studies.release import SHOWN
from mechsim.studies.sweep.task import SweepTask

# instants of a run after the first
SAMPLES = 500
# fraction of its change within which a settled quantity stays, and latest settling time relative to the run
SETTLING_BAND, MAX_SETTLING_FRACTION = 0.02, 0.9


def released_alone(task: SweepTask, solver: KinematicSolver) -> dict[str, float]:
    """Return the measures of a design that need vibrations or a run from the initial state.

    Raises:
        AssemblyError: without equilibrium or the requested mode, or for a run that fails or does not settle.
    """
    measures = [measure for measure in task.measures if measure.released]
    if not measures:
        return {}
    assert task.release is not None
    release = replace(task.release, model=dynamic_model(solver))
    result: dict[str, float] = {}
    vibrations = [measure for measure in measures if measure.number]
    modes = nearest_equilibrium(release.model, initial=release.initial).modes if vibrations else ()
    for measure in vibrations:
        if measure.number > len(modes):
            raise AssemblyError(f"there is no mode {measure.number}; the highest is {len(modes)}")
        mode = modes[measure.number - 1]
        result[measure.name] = mode.frequency if measure.kind == "frequency" else mode.damping_ratio
    timed = [measure for measure in measures if not measure.number]
    if not timed:
        return result
    run = release.run(SAMPLES)
    if run.outcome not in SHOWN:
        raise AssemblyError(f"the run ended early ({run.outcome}): {run.reason}")
    values = release.values(run, [measure.subject for measure in timed])
    columns: Mapping[str, Array] = {quantity.name: column for quantity, column in values.items()}
    for measure in timed:
        column = columns[measure.subject]
        settling = measure.kind == "settling"
        result[measure.name] = (
            _settling(measure.subject, run.time, column) if settling else float(np.abs(column).max())
        )
    return result


def _settling(name: str, time: Array, values: Array) -> float:
    """Return the instant after which a quantity stays near its last value, in [s]."""
    outside = np.abs(values - values[-1]) > SETTLING_BAND * np.ptp(values)
    last = int(np.flatnonzero(outside)[-1]) if outside.any() else 0
    if time[last] > MAX_SETTLING_FRACTION * time[-1]:
        raise AssemblyError(f"{name} does not settle within {time[-1]:g} s; give a longer duration")
    return float(time[last])
