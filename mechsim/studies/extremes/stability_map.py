"""The stability map: all axes of selected mechanisms, and the borders between outcomes."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from mechsim.analytic.solvers import KinematicSolver
from mechsim.model.progress import Progress, no_progress
from mechsim.studies.extremes import axes
from mechsim.studies.extremes.results import StabilityMap, Trial
from mechsim.studies.extremes.trial import borders_along
from mechsim.subjects import catalog

# number of bisections of a border, which locate it to a twentieth of a decade, and that of a quick study
HALVINGS, QUICK_HALVINGS = 5, 2

Push = Callable[[Any, float], Trial]


def _decades(low: float, high: float, interval: int = 1) -> list[float]:
    return [10.0**n for n in range(round(np.log10(low)), round(np.log10(high)) + 1, interval)]


def axes_of(solver: KinematicSolver, quick: bool) -> list[tuple[str, Push, Sequence[float]]]:
    """Return the axes of one mechanism: name, trial at a value, values from stable to unstable."""
    coarse = 2 if quick else 1
    steps = [1e4, 1e3, 100.0, 50.0, 20.0, 10.0]
    pushes: list[tuple[str, Push, Sequence[float]]] = [
        ("steps", axes.steps, steps if quick else [1e5, *steps])
    ]
    if solver.motion_laws.crank:
        pushes.append(("speed", axes.speed, [1.0, 1e3, 1e5, 1e6, 1e7]))
    if solver.closed_form is not None:
        pushes += [
            ("size", axes.characteristic_length, [1e-2, *_decades(1e-9, 1e-3, coarse)[::-1]]),
            ("size", axes.characteristic_length, [1e-1, *_decades(1.0, 1e9, 2 * coarse - 1)]),
        ]
    if axes.coupler_of(solver.mechanism) is not None:
        pushes += [
            ("mass ratio", axes.mass_ratio, [*_decades(1e-12, 1.0, 2 * coarse)[::-1], 0.0]),
            ("mass ratio", axes.mass_ratio, _decades(10.0, 1e11, 2 * coarse)),
        ]
    for seed in range(2 if quick else 6):
        errors = [1e-3, 1e-2, 0.1, 0.3, 1.0, 3.0]
        pushes.append(("far start", partial(axes.far_start, seed=seed), errors))
    return pushes


def study(
    solvers: Sequence[KinematicSolver] | None = None,
    *,
    quick: bool = False,
    progress: Progress = no_progress,
) -> StabilityMap:
    """Vary the quantity of each axis until runs fail.

    Args:
        solvers: mechanisms; None selects those of the catalogue.
        quick: fewer values and coarser borders.
        progress: callback after each axis of each mechanism.
    """
    result = StabilityMap()
    solvers = solvers or [catalog.make(name) for name in catalog.MECHANISMS]
    total = sum(len(axes_of(solver, quick)) for solver in solvers)
    finished = 0
    for solver in solvers:
        name = solver.name
        for axis, push, values in axes_of(solver, quick):
            trials, borders = borders_along(
                partial(push, solver), values, QUICK_HALVINGS if quick else HALVINGS
            )
            result.trials += trials
            result.borders += borders if axis != "far start" else []
            finished += 1
            progress(f"{name}: {axis}", finished / total)
    return result
