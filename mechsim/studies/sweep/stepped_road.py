"""Designs stepped in MuJoCo: all that are alike in one batch, any other by itself."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.closure.start_values import with_closed_guess
from mechsim.analytic.forms import Form
from mechsim.errors import AssemblyError
from mechsim.maths.arrays import Array
from mechsim.model.crank_profile import closes_nowhere, within_range
from mechsim.model.motion import taken
from mechsim.simulation.dynamics.prescribed_motion import driven
from mechsim.simulation.many.design_models import design_models
from mechsim.simulation.many.design_motion import Told, design_motion
from mechsim.simulation.many.design_torque import design_torque
from mechsim.simulation.many.stepped_designs import SteppedDesigns, judged, parted, stepped_designs
from mechsim.simulation.mjcf.joints import CRANK
from mechsim.simulation.run import simulate
from mechsim.studies.sweep.beginning import begun_designs
from mechsim.studies.sweep.measures import table_of
from mechsim.studies.sweep.task import Measured, SweepTask
from mechsim.studies.sweep.turns import Turns

Rows = NDArray[np.intp]
BROKEN = "MuJoCo's state went bad, or the linkage turned its flywheel; take more steps, or softer constraints"


def stepped_together(task: SweepTask, rows: Mapping[str, Array], index: Rows, found: Measured) -> Rows:
    """Step designs together and measure them; return those that this does not settle.

    Args:
        task: the sweep.
        rows: parameter -> its value in each design.
        index: which designs are to be stepped.
        found: takes what is measured of them.
    """
    like = task.like
    if like is None or not len(index):
        return index
    assert task.settings is not None
    begun = begun_designs(task, {name: values[index] for name, values in rows.items()}, whole=task.loaded)
    if begun is None:
        return index
    own = index[begun.which]
    try:
        models = design_models(like, begun.started, begun.mechanisms)
        stepped = stepped_designs(models, task.settings, task.pace, task.samples * task.stride, task.stride)
        verdict = judged(stepped)
    except np.linalg.LinAlgError:
        return index
    good = stepped.whole & verdict.kept
    _measure(task, stepped, np.flatnonzero(good), own, found)
    for i in np.flatnonzero(good & ~(verdict.estimate <= verdict.tolerance)):
        found.refuse(own[[i]], "missed", too_far(verdict.estimate[i], verdict.tolerance[i]))
    lost = np.flatnonzero(~good)
    open_at = parted(stepped, lost) if len(lost) else np.zeros(0)
    refused = np.isfinite(open_at)
    broken = lost[~refused & ~stepped.whole[lost]]
    found.refuse(own[broken], "diverged", BROKEN)
    # those that come apart may swing, which each by itself shows
    unsettled = np.setdiff1d(lost, broken)
    return np.setdiff1d(index, np.delete(own, unsettled))


def _measure(task: SweepTask, stepped: SteppedDesigns, rows: Rows, own: Rows, found: Measured) -> None:
    """Measure the motions of designs, some at a time."""
    if not len(rows):
        return
    motion, efforts = design_motion(stepped, rows, task.records, _told(task)), dict[str, Array]()
    if task.loaded:
        assert task.settings is not None
        efforts["torque"] = design_torque(stepped, rows, task.records, task.settings.compliance_used)
    turns = Turns(len(rows), len(task.records), motion, efforts)
    values = table_of(task.measures, turns, task.places)
    found.take(own[rows], values)


def _told(task: SweepTask) -> Told:
    """Return how much of a motion the measures need."""
    if task.accelerated:
        return "rates"
    return "places" if task.wants("stroke") or task.wants("point") else "joints"


def stepped_alone(task: SweepTask, form: Form) -> tuple[dict[str, float], str, str]:
    """Step one design; return its measures, its outcome, and why it is not met.

    Raises:
        AssemblyError: where it cannot be put together all along the motion.
    """
    form = with_closed_start(form)
    programs, prescribed = form.programs, prescribed_motion(form, task.pace)
    asked: dict[str, Any] = {"method": "step", "settings": task.settings, "samples": task.intervals}
    asked |= prescribed
    if "profile" in prescribed and task.places:
        raise AssemblyError(
            f"{form.name}: the crank swings, and no instant of a stepped swing is recorded at a given angle; "
            "leave out --method step or at:ANGLE measures"
        )
    run = simulate(form, **asked)
    if run.outcome in ("diverged", "changed assembly"):
        return {}, run.outcome, run.motion.broken or "it went on in another assembly"
    motion, efforts = run.motion, {}
    if task.loaded:
        acting = getattr(form, "forces", None)
        study = driven(form.mechanism, acting, **asked)
        motion = study.motion
        efforts = {name: column[task.records][None] for name, column in study.efforts.columns()}
    mechanism = form.mechanism
    if mechanism.has_crank and programs is None:
        # MuJoCo's crank is called so
        joints = {
            (mechanism.crank.name if name == CRANK else name): one for name, one in motion.joints.items()
        }
        motion = replace(motion, joints=joints)
    turns = Turns(1, len(task.records), taken(motion, task.records), efforts)
    values = {name: float(one[0]) for name, one in table_of(task.measures, turns, task.places).items()}
    return values, run.outcome, "" if run.outcome == "met" else too_far(run.estimate, run.tolerance)


def with_closed_start(form: Form) -> Form:
    """Return a design that starts assembled, so that MuJoCo and the formulas are in one assembly."""
    if isinstance(form, ClosedForm):
        return form
    return replace(form, mechanism=with_closed_guess(form.mechanism))


def prescribed_motion(form: Form, pace: float) -> dict[str, Any]:
    """Return how a design moves, as `simulate` takes it: its laws, a speed in [rad/s], or a swing.

    Raises:
        AssemblyError: where its loops close at no crank angle.
    """
    if form.programs is not None:
        return {"programs": form.programs}
    arcs = form.crank_range()
    if arcs.full:
        return {"speed": pace}
    if not arcs.arcs:
        raise closes_nowhere(form.name)
    return {"profile": within_range(form.mechanism, arcs, pace)}


def too_far(estimate: float, tolerance: float) -> str:
    """Return why a stepped design is missed."""
    return f"places within {estimate:.3g} m of the solved poses (bound {tolerance:.3g} m)"
