"""Designs run in time: stepped in MuJoCo, or released from an initial state."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.dynamics import dynamic_model, nearest_equilibrium
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import AssemblyError
from mechsim.model.motion import select_instants
from mechsim.model.motion_laws import no_crank_range_error, within_range
from mechsim.numerics.arrays import Array
from mechsim.simulation.design_models import design_models
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.mjcf.joints import CRANK
from mechsim.simulation.run import simulate
from mechsim.simulation.stepped_designs import (
    Content,
    SteppedDesigns,
    check_designs,
    design_motion,
    design_torque,
    first_open_angle,
    stepped_designs,
)
from mechsim.studies.release import SHOWN, Release
from mechsim.studies.sweep.measures import TurnMeasure, Turns
from mechsim.studies.sweep.task import Measured, SweepTask, assembled_designs

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
    vibrations = [measure for measure in measures if measure.number]
    timed = [measure for measure in measures if not measure.number]
    return _of_modes(release, vibrations) | _of_run(release, timed)


def _of_modes(release: Release, measures: list[TurnMeasure]) -> dict[str, float]:
    if not measures:
        return {}
    modes = nearest_equilibrium(release.model, initial=release.initial).modes
    result: dict[str, float] = {}
    for measure in measures:
        if measure.number > len(modes):
            raise AssemblyError(f"there is no mode {measure.number}; the highest is {len(modes)}")
        mode = modes[measure.number - 1]
        result[measure.name] = mode.frequency if measure.kind == "frequency" else mode.damping_ratio
    return result


def _of_run(release: Release, measures: list[TurnMeasure]) -> dict[str, float]:
    if not measures:
        return {}
    run = release.run(SAMPLES)
    if run.outcome not in SHOWN:
        raise AssemblyError(f"the run ended early ({run.outcome}): {run.reason}")
    values = release.values(run, [measure.subject for measure in measures])
    columns: Mapping[str, Array] = {quantity.name: column for quantity, column in values.items()}
    return {
        measure.name: _settling(measure.subject, run.time, columns[measure.subject])
        if measure.kind == "settling"
        else float(np.abs(columns[measure.subject]).max())
        for measure in measures
    }


def _settling(name: str, time: Array, values: Array) -> float:
    """Return the instant after which a quantity stays near its last value, in [s]."""
    outside = np.abs(values - values[-1]) > SETTLING_BAND * np.ptp(values)
    last = int(np.flatnonzero(outside)[-1]) if outside.any() else 0
    if time[last] > MAX_SETTLING_FRACTION * time[-1]:
        raise AssemblyError(f"{name} does not settle within {time[-1]:g} s; give a longer duration")
    return float(time[last])


Rows = NDArray[np.intp]
DIVERGED_REASON = (
    "MuJoCo's state became invalid, or the linkage moved its drive; take more steps, or softer constraints"
)


def stepped_together(task: SweepTask, rows: Mapping[str, Array], index: Rows, result: Measured) -> Rows:
    """Step designs together and measure them; return those that this cannot determine.

    Args:
        task: the sweep.
        rows: parameter -> its value in each design.
        index: of the designs to step.
        result: receives the measures.
    """
    like = task.like
    if like is None or not len(index):
        return index
    assert task.settings is not None
    assembled = assembled_designs(
        task, {name: values[index] for name, values in rows.items()}, with_mechanisms=task.measures.loaded
    )
    if assembled is None:
        return index
    numbers = index[assembled.which]
    try:
        models = design_models(like, assembled.started, assembled.mechanisms)
        stepped = stepped_designs(
            models, task.settings, task.path_speed, task.samples * task.steps_per_pose, task.steps_per_pose
        )
        verdict = check_designs(stepped)
    except np.linalg.LinAlgError:
        return index
    valid = stepped.valid & verdict.same_assembly
    _measure(task, stepped, np.flatnonzero(valid), numbers, result)
    for i in np.flatnonzero(valid & ~(verdict.estimate <= verdict.tolerance)):
        result.reject(numbers[[i]], "failed", tolerance_text(verdict.estimate[i], verdict.tolerance[i]))
    failed = np.flatnonzero(~valid)
    separations = first_open_angle(stepped, failed) if len(failed) else np.zeros(0)
    separated = np.isfinite(separations)
    diverged = failed[~separated & ~stepped.valid[failed]]
    result.reject(numbers[diverged], "diverged", DIVERGED_REASON)
    # open loops may belong to a swinging crank, which a single run determines
    undetermined = np.setdiff1d(failed, diverged)
    return np.setdiff1d(index, np.delete(numbers, undetermined))


def _measure(task: SweepTask, stepped: SteppedDesigns, rows: Rows, numbers: Rows, result: Measured) -> None:
    """Measure the motions of designs."""
    if not len(rows):
        return
    motion, forces = design_motion(stepped, rows, task.records, _detail(task)), dict[str, Array]()
    if task.measures.loaded:
        assert task.settings is not None
        forces["torque"] = design_torque(stepped, rows, task.records, task.settings.compliance_used)
    turns = Turns(len(rows), len(task.records), motion, forces)
    values = task.values(turns)
    result.store(numbers[rows], values)


def _detail(task: SweepTask) -> Content:
    """Return the level of detail that the measures need."""
    if task.measures.accelerated:
        return "rates"
    return "positions" if task.measures.includes("stroke") or task.measures.uses("point") else "joints"


def stepped_alone(task: SweepTask, solver: KinematicSolver) -> tuple[dict[str, float], str, str]:
    """Step one design; return its measures, its outcome, and the reason if it is not "passed".

    Raises:
        AssemblyError: if it cannot be assembled along the whole motion.
    """
    prescribed = prescribed_motion(solver, task.path_speed)
    options: dict[str, Any] = {"method": "step", "settings": task.settings, "samples": task.intervals}
    options |= prescribed
    if "profile" in prescribed and task.angle_index:
        raise AssemblyError(
            f"{solver.name}: the crank swings, and a stepped swing records no instant at a given angle; "
            "leave out --method step or at:ANGLE measures"
        )
    run = simulate(solver, **options)
    if run.outcome in ("diverged", "changed assembly"):
        return {}, run.outcome, run.motion.broken or "it continued in another assembly"
    motion, forces = run.motion, {}
    if task.measures.loaded:
        acting = solver.forces
        study = driven(solver.mechanism, acting, **options)
        motion = study.motion
        forces = {name: column[task.records][None] for name, column in study.forces.columns()}
    mechanism = solver.mechanism
    if mechanism.has_crank and solver.motion_laws.crank:
        # the crank's name in generated models
        joints = {
            (mechanism.crank.name if name == CRANK else name): value for name, value in motion.joints.items()
        }
        motion = replace(motion, joints=joints)
    turns = Turns(1, len(task.records), select_instants(motion, task.records), forces)
    values = {name: float(value[0]) for name, value in task.values(turns).items()}
    return values, run.outcome, "" if run.outcome == "passed" else tolerance_text(run.estimate, run.tolerance)


def prescribed_motion(solver: KinematicSolver, speed: float) -> dict[str, Any]:
    """Return the driver motion of a design as arguments of `simulate`: laws, a speed in [rad/s], or a swing.

    Raises:
        AssemblyError: if its loops close at no crank angle.
    """
    if not solver.motion_laws.crank:
        return {"motion_laws": solver.motion_laws}
    arcs = solver.crank_range()
    if arcs.full:
        return {"speed": speed}
    if not arcs.arcs:
        raise no_crank_range_error(solver.name)
    return {"profile": within_range(solver.mechanism, arcs, speed)}


def tolerance_text(estimate: float, tolerance: float) -> str:
    """Return the reason text of a stepped design that misses its tolerance."""
    return f"positions differ by {estimate:.3g} m from the solved poses (tolerance {tolerance:.3g} m)"
