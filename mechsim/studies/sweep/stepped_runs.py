"""Designs stepped in MuJoCo: those of equal topology in one batch, others one by one."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.loops.start import with_closed_guess
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import AssemblyError
from mechsim.model.motion import select_instants
from mechsim.model.motion_laws import no_crank_range_error, within_range
from mechsim.numerics.arrays import Array
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.many.design_models import design_models
from mechsim.simulation.many.stepped_designs import (
    Content,
    SteppedDesigns,
    check_designs,
    design_motion,
    design_torque,
    first_open_angle,
    stepped_designs,
)
from mechsim.simulation.mjcf.joints import CRANK
from mechsim.simulation.run import simulate
from mechsim.studies.sweep.assembled_designs import assembled_designs
from mechsim.studies.sweep.measures import Turns
from mechsim.studies.sweep.task import Measured, SweepTask

Rows = NDArray[np.intp]
DIVERGED_REASON = (
    "MuJoCo's state went bad, or the linkage moved its drive; take more steps, or softer constraints"
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
        result.reject(numbers[[i]], "failed", too_far(verdict.estimate[i], verdict.tolerance[i]))
    failed = np.flatnonzero(~valid)
    separations = first_open_angle(stepped, failed) if len(failed) else np.zeros(0)
    separated = np.isfinite(separations)
    diverged = failed[~separated & ~stepped.valid[failed]]
    result.reject(numbers[diverged], "diverged", DIVERGED_REASON)
    # loops that open may belong to a swinging crank, which a single run shows
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
    return "positions" if task.measures.wants("stroke") or task.measures.uses("point") else "joints"


def stepped_alone(task: SweepTask, solver: KinematicSolver) -> tuple[dict[str, float], str, str]:
    """Step one design; return its measures, its outcome, and the reason if it is not "passed".

    Raises:
        AssemblyError: if it cannot be assembled along the whole motion.
    """
    solver = with_closed_start(solver)
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
        return {}, run.outcome, run.motion.broken or "it went on in another assembly"
    motion, forces = run.motion, {}
    if task.measures.loaded:
        acting = solver.forces
        study = driven(solver.mechanism, acting, **options)
        motion = study.motion
        forces = {name: column[task.records][None] for name, column in study.forces.columns()}
    mechanism = solver.mechanism
    if mechanism.has_crank and solver.motion_laws.crank:
        # the generator's name of the crank
        joints = {
            (mechanism.crank.name if name == CRANK else name): value for name, value in motion.joints.items()
        }
        motion = replace(motion, joints=joints)
    turns = Turns(1, len(task.records), select_instants(motion, task.records), forces)
    values = {name: float(value[0]) for name, value in task.values(turns).items()}
    return values, run.outcome, "" if run.outcome == "passed" else too_far(run.estimate, run.tolerance)


def with_closed_start(solver: KinematicSolver) -> KinematicSolver:
    """Return a design that starts assembled, so that MuJoCo and the formulas use the same assembly."""
    if not isinstance(solver, LoopForm):
        return solver
    return replace(solver, mechanism=with_closed_guess(solver.mechanism))


def prescribed_motion(solver: KinematicSolver, speed: float) -> dict[str, Any]:
    """Return how a design moves, as `simulate` takes it: its laws, a speed in [rad/s], or a swing.

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


def too_far(estimate: float, tolerance: float) -> str:
    """Return the reason of a stepped design that misses its tolerance."""
    return f"places within {estimate:.3g} m of the solved poses (bound {tolerance:.3g} m)"
