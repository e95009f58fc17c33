"""Views of mechanisms with several drivers, of runs from an initial state and of modes of vibration."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from mechsim.errors import AssemblyError, MechsimError
from mechsim.kinematics.loops.motion import driven_path, solve_along
from mechsim.kinematics.loops.path import LoopPath
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.masses import summary
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion import Motion
from mechsim.mechanism.motion_laws import make_motion_laws, steady
from mechsim.pictures.render.drawn_model import drawn_as
from mechsim.pictures.view.pose_grid import GhostTrack, PoseGrid, View, ghost_of, motion_grid
from mechsim.studies.drawn_motion import stepped
from mechsim.studies.release import Release
from mechsim.studies.scene.own_settings import runs_as_published


def release_view(release: Release, mode: int | None) -> View:
    """Return the contents of a page for a run from an initial state, or for a mode of vibration.

    Args:
        release: the initial state.
        mode: number of the mode, from 1; None shows the run.

    Raises:
        InputError: where there is no such mode, or the run broke down.
    """
    model = release.model
    if mode is None:
        motion, name = release.shown_run(SAMPLES).motion, release.title
        fact = "Integrated from the initial state; no driver is prescribed."
    else:
        cycle = release.cycle(mode, SAMPLES)
        motion, name = cycle.motion, f"mode {mode}"
        fact = f"One cycle of {cycle.title}, its amplitude large enough to be seen."
    title = f"{model.mechanism.name}, {name}"
    facts = [fact, f"{summary(model.masses).capitalize()}."]
    assert motion.time is not None
    grid = motion_grid(name, model.mechanism, motion, nodes=motion.time, driver="time", unit="s")
    return View(model.mechanism, [grid], title, facts, **drawn_as(model.solver))


def stepped_ghost(solver: KinematicSolver, run: Motion) -> GhostTrack | None:
    """Return where a stepped run of MuJoCo puts the links; None for a run that broke down."""
    name = "MuJoCo, the file's own settings" if runs_as_published(solver) else "MuJoCo, stepped"
    return None if run.broken else ghost_of(name, solver.mechanism, solver.solve_as(run), run)


# intervals of the time of motion laws
SAMPLES = 360
# range of a driver moved by hand to either side without limits of a file: in [rad], and relative to the size
MANUAL_RANGE = {"rad": np.deg2rad(45.0), "m": 0.25}
# part of the way to a singular pose that is shown
KEPT_SHORT = 0.99


def motion_law_grid(solver: KinematicSolver) -> PoseGrid:
    """Return the poses over the time of the motion laws of a mechanism.

    Raises:
        AssemblyError: where the loops do not close on the way.
    """
    laws = solver.motion_laws
    times = np.linspace(0.0, laws.duration, SAMPLES + 1)
    motion = solver.solve(t=times)
    grid = motion_grid("motion laws", solver.mechanism, motion, driver="time", unit="s", nodes=times)
    with suppress(MechsimError):
        run = stepped(solver, laws.path_profile, SAMPLES // 2)
        grid = replace(grid, ghost=stepped_ghost(solver, run))
    return grid


def hand_grids(
    solver: KinematicSolver, limits: Mapping[str, tuple[float, float]], start: Mapping[str, float]
) -> list[PoseGrid]:
    """Return a grid of each driver, moved as far as its assembly can be followed with the others at rest.

    Args:
        solver: the mechanism's solver.
        limits: joint -> its range, if a file states it.
        start: driver -> initial value, for drivers without a motion law.
    """
    solver.mechanism.require_driver()
    begin = {**start, **solver.motion_laws.first}
    return [
        _hand_grid(solver.mechanism, name, begin, *_hand_range(solver, name, begin[name], limits))
        for name in solver.mechanism.drivers
    ]


def _hand_range(
    solver: KinematicSolver, name: str, first: float, limits: Mapping[str, tuple[float, float]]
) -> tuple[float, float]:
    """Return the range of a driver: half as large again as that of its motion law, within its limits."""
    values, unit = np.array([first]), solver.mechanism.unit(name)
    if name in solver.motion_laws.by_name:
        times = np.linspace(0.0, solver.motion_laws.duration, 257)
        values = solver.motion_laws.by_name[name](times)[0]
    middle, reach = 0.5 * (np.min(values) + np.max(values)), 0.75 * float(np.ptp(values))
    least = MANUAL_RANGE[unit] * (1.0 if unit == "rad" else solver.mechanism.characteristic_length)
    reach = min(max(reach, least), np.pi if unit == "rad" else np.inf)
    low, high = limits.get(name, (-np.inf, np.inf))
    return max(float(middle) - reach, low), min(float(middle) + reach, high)


def _hand_grid(
    mechanism: Mechanism, moved: str, start: Mapping[str, float], low: float, high: float
) -> PoseGrid:
    """Return the poses over one driver within a range, the others where they start."""
    states = {driver: steady(start[driver], 1.0 if driver == moved else 0.0) for driver in mechanism.drivers}
    laws = make_motion_laws(mechanism, states, 1.0)
    path = driven_path(mechanism, laws)
    ends = [(end - start[moved]) * laws.rate for end in (low, high)]
    parameter = np.linspace(_reached(path, -1, ends[0]), _reached(path, 1, ends[1]), SAMPLES + 1)
    motion = solve_along(path, parameter, laws.rate, 0.0, laws)
    unit, nodes = "m" if mechanism.unit(moved) == "m" else "rad", start[moved] + parameter / laws.rate
    grid = motion_grid(f"move {moved}", mechanism, motion, nodes=nodes, driver=moved, unit=unit, speeds=False)
    return replace(grid, slider=replace(grid.slider, start=start[moved]))


def _reached(path: LoopPath, direction: int, end: float) -> float:
    """Return the path parameter up to which a path is shown towards an end: short of a singular pose."""
    try:
        path.extend(end)
    except AssemblyError:
        return KEPT_SHORT * path.end(direction)
    return end
