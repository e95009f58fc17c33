"""Views of a run from an initial state and of a mode of vibration."""

from dataclasses import replace

import numpy as np

from mechsim.model.masses import summary
from mechsim.model.motion import Motion, select_instants
from mechsim.pictures.render.file_bodies import drawn_as
from mechsim.pictures.view import PoseGrid, View, between, motion_grid
from mechsim.studies.release import Release

# intervals that the page holds; the run is solved twice as densely to measure the error between them
SAMPLES = 360
SHOWN, MIDDLES = slice(None, None, 2), slice(1, None, 12)


def release_view(release: Release, mode: int | None) -> View:
    """Return what a page shows of a run from an initial state, or of a mode of vibration.

    Args:
        release: the initial state.
        mode: number of the mode, from 1; None shows the run.

    Raises:
        InputError: where there is no such mode, or the run broke down.
    """
    model = release.model
    if mode is None:
        motion, name = release.shown_run(2 * SAMPLES).motion, "released"
        fact = "Integrated from the initial state, its drivers free."
    else:
        cycle = release.cycle(mode, 2 * SAMPLES)
        motion, name = cycle.motion, f"mode {mode}"
        fact = f"One cycle of {cycle.title}, its amplitude large enough to be seen."
    title = f"{model.mechanism.name.replace('_', '-')}, {name}"
    facts = [fact, f"{summary(model.masses).capitalize()}."]
    return View(model.mechanism, [_grid(release, motion, name)], title, facts, **drawn_as(model.drive))


def _grid(release: Release, motion: Motion, name: str) -> PoseGrid:
    """Return every second instant over time, and the error between them at some of the others."""
    assert motion.time is not None
    shown, others = select_instants(motion, SHOWN), select_instants(motion, MIDDLES)
    grid = motion_grid(
        name, release.model.mechanism, shown, driver="time", unit="s", nodes=motion.time[SHOWN]
    )
    return replace(grid, error=between(grid, others, np.asarray(motion.time[MIDDLES])))
