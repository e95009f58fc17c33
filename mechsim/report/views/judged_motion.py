"""The motions that a validation judged, on a page to turn by hand."""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import MechsimError
from mechsim.model.motion import taken
from mechsim.numerics.arrays import Array
from mechsim.pictures.render.file_bodies import drawn_as
from mechsim.pictures.view import PoseGrid, View, between, ghost_of, motion_grid
from mechsim.report.views.crank_grids import lapped, marks_of
from mechsim.studies.validate import Case


def case_view(case: Case) -> View | None:
    """Return what a page shows of a validation; None of a motion without links."""
    drive, motion = case.drive, case.exact
    if not motion.links:
        return None
    rising = slice(None) if motion.drivers else slice(0, 1 + int(np.argmax(motion.angle)))
    shown = taken(motion, rising)
    if motion.drivers and shown.time is not None:
        grid = motion_grid("judged", drive.mechanism, shown, driver="time", unit="s", nodes=shown.time)
    else:
        marks = [one for mark in marks_of(drive) for one in lapped(mark, shown.angle)]
        grid = motion_grid("judged", drive.mechanism, shown, driver=drive.mechanism.crank.name, marks=marks)
    with suppress(MechsimError):
        grid = replace(_with_ghost(case, grid), error=_error(case, grid, shown.angle))
    fact = f"The motion that was judged: {motion.source}, {len(shown)} poses, verdict {case.verdict.outcome}."
    return View(drive.mechanism, [grid], drive.name.replace("_", "-"), [fact], **drawn_as(drive))


def _with_ghost(case: Case, grid: PoseGrid) -> PoseGrid:
    run = case.run.motion
    if case.quick or run.broken:
        return grid
    if isinstance(case.drive, LoopForm):
        exact = case.drive.solve_as(run)
    else:
        exact = case.drive.solve_along(run.angle, run.speed, run.acceleration)
    rows = slice(None) if run.drivers else slice(0, 1 + int(np.argmax(run.angle)))
    return replace(grid, ghost=ghost_of("MuJoCo, stepped", case.drive.mechanism, exact, run, rows))


def _error(case: Case, grid: PoseGrid, angles: Array) -> float:
    """Return the largest error of a place in the middle between poses, in [m]."""
    middles, nodes = 0.5 * (angles[1:] + angles[:-1]), grid.sliders[0].nodes
    return between(grid, case.drive.solve_along(middles), 0.5 * (nodes[1:] + nodes[:-1]))
