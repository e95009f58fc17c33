"""Poses along curves of assemblies: what no closed form names, and what lies beyond dead centres."""

from dataclasses import replace

import numpy as np

from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import MechsimError
from mechsim.model.motion import taken
from mechsim.pictures.view import Mark, PoseGrid, Readout, between, motion_grid
from mechsim.theory.continuation import AssemblyCurve, even_motion, trace

# intervals of a curve, and random starts from which curves are sought
SAMPLES, STARTS = 360, 60
MOST_CURVES = 6
# of a motion with twice the samples: what the page holds, and some between to measure its error at
NODES, MIDDLES, BACKWARDS = slice(None, None, 2), slice(1, None, 12), slice(None, None, -1)


def curve_grids(form: Form) -> tuple[list[PoseGrid], str]:
    """Return a grid for each curve of assemblies besides that which the crank's own slider shows whole.

    Returns:
        The grids, and a sentence on what was sought; empty where no curve could be followed.
    """
    own_alone = not isinstance(form, LoopForm)
    swings = not form.crank_range().full
    if own_alone and not swings:
        return [], ""
    try:
        found = trace(form, starts=0 if own_alone else STARTS)
    except MechsimError as error:
        return [], f"Other assemblies are not shown: {error}"
    grids: list[PoseGrid] = []
    for i, curve in enumerate(found.curves[:MOST_CURVES]):
        if i == 0 and not swings:
            continue
        name = "round its dead centres" if i == 0 else f"assembly {i + 1}"
        grids.append(_turning(form, name, curve) if curve.turns else _round(form, name, curve))
    said = f"Assemblies were sought from {found.starts} random starts; {len(found.curves)} curves were found."
    return grids, "" if own_alone else said


def _turning(form: Form, name: str, curve: AssemblyCurve) -> PoseGrid:
    """Return the poses of a curve over which the crank turns fully, over its angle."""
    motion = even_motion(curve, 2 * SAMPLES * abs(curve.turns), 1.0)
    if motion.angle[-1] < motion.angle[0]:
        motion = taken(motion, BACKWARDS)
    shown, beside = taken(motion, NODES), taken(motion, MIDDLES)
    driver = form.mechanism.crank.name
    grid = motion_grid(name, form.mechanism, shown, driver=driver, speeds=False)
    return replace(grid, error=between(grid, beside, beside.angle))


def _round(form: Form, name: str, curve: AssemblyCurve) -> PoseGrid:
    """Return the poses of a curve over which the crank swings, over a slider that goes round it evenly."""
    motion = even_motion(curve, 2 * SAMPLES, 1.0)
    shown, beside = taken(motion, NODES), taken(motion, MIDDLES)
    along = np.linspace(0.0, 100.0, len(motion))
    marks = [Mark(100.0 * at.arc / curve.length, "dead centre", "dead") for at in curve.crank_turns]
    grid = motion_grid(
        name,
        form.mechanism,
        replace(shown, joints={}),
        driver="along the curve",
        unit="%",
        nodes=along[NODES],
        marks=sorted(marks, key=lambda mark: mark.at),
        extra=[Readout(form.mechanism.crank.name, "rad", {"": shown.angle})],
        speeds=False,
    )
    error = between(grid, beside, along[MIDDLES])
    return replace(grid, error=error, said="at an even pace round the curve of assemblies")
