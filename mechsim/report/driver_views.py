"""Views of mechanisms with several drivers, of runs from an initial state and of modes of vibration."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.motion import driven_path, solve_along
from mechsim.analytic.loops.path import LoopPath
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import AssemblyError, MechsimError
from mechsim.model.link_poses import moved_links, with_rods
from mechsim.model.masses import summary
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion, select_instants
from mechsim.model.motion_laws import make_motion_laws, steady
from mechsim.model.quantities import moving_points
from mechsim.numerics.arrays import Array
from mechsim.pictures.render.drawn_model import drawn_as
from mechsim.pictures.view.pose_grid import (
    GhostTrack,
    PoseGrid,
    Readout,
    Slider,
    View,
    between,
    ghost_of,
    interpolated,
    motion_grid,
    quaternions,
)
from mechsim.studies.drawn_motion import stepped
from mechsim.studies.release import Release
from mechsim.studies.scene.own_settings import runs_as_published

# of a motion with twice the samples: what the page holds, and some between to measure its error at
SHOWN, MIDDLES = slice(None, None, 2), slice(1, None, 12)


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
        motion, name = release.shown_run(2 * SAMPLES).motion, release.title
        fact = "Integrated from the initial state; no driver is prescribed."
    else:
        cycle = release.cycle(mode, 2 * SAMPLES)
        motion, name = cycle.motion, f"mode {mode}"
        fact = f"One cycle of {cycle.title}, its amplitude large enough to be seen."
    title = f"{model.mechanism.name}, {name}"
    facts = [fact, f"{summary(model.masses).capitalize()}."]
    assert motion.time is not None
    grid = halved_grid(name, model.mechanism, motion, nodes=motion.time, driver="time", unit="s")
    return View(model.mechanism, [grid], title, facts, **drawn_as(model.solver))


def halved_grid(name: str, mechanism: Mechanism, motion: Motion, nodes: Array, **slider: Any) -> PoseGrid:
    """Return the grid of every second instant of a motion, with the error of interpolation at some others.

    Args:
        name: name on the page.
        mechanism: the mechanism.
        motion: with links, at rising values of the slider.
        nodes: these values, (n,).
        slider: further arguments of `motion_grid`.
    """
    grid = motion_grid(name, mechanism, select_instants(motion, SHOWN), nodes=nodes[SHOWN], **slider)
    return replace(grid, error=between(grid, select_instants(motion, MIDDLES), nodes[MIDDLES]))


def stepped_ghost(solver: KinematicSolver, run: Motion) -> GhostTrack | None:
    """Return where a stepped run of MuJoCo puts the links; None for a run that broke down."""
    name = "MuJoCo, the file's own settings" if runs_as_published(solver) else "MuJoCo, stepped"
    return None if run.broken else ghost_of(name, solver.mechanism, solver.solve_as(run), run)


# intervals of the time of motion laws
SAMPLES = 360
# number of nodes of each driver, by the number of drivers; more drivers are moved one at a time
NODES: Mapping[int, int] = {1: 121, 2: 25, 3: 7}
ALONE = 61
# range of a driver moved by hand to either side without limits of a file: in [rad], and relative to the size;
# with three drivers the whole box must be far from singular poses, or following to its edges takes minutes
MANUAL_RANGE = {"rad": (np.deg2rad(45.0), np.deg2rad(20.0)), "m": (0.25, 0.1)}
# settings between nodes at which the error is measured: of the last driver, and of the others
PROBED = 6


@dataclass(frozen=True, slots=True)
class Box:
    """Initial values of drivers, and their ranges.

    Attributes:
        start: driver -> value in SI.
        low: driver -> least value.
        high: driver -> greatest value.
    """

    start: Mapping[str, float]
    low: Mapping[str, float]
    high: Mapping[str, float]


def motion_law_grid(solver: KinematicSolver) -> PoseGrid:
    """Return the poses over the time of the motion laws of a mechanism.

    Raises:
        AssemblyError: where the loops do not close on the way.
    """
    laws = solver.motion_laws
    times = np.linspace(0.0, laws.duration, SAMPLES + 1)
    motion = solver.solve(t=times)
    grid = motion_grid("motion laws", solver.mechanism, motion, driver="time", unit="s", nodes=times)
    middles = 0.5 * (times[:-1] + times[1:])[:: SAMPLES // 60]
    exact = solver.solve(t=middles)
    grid = replace(grid, error=between(grid, exact, middles))
    with suppress(MechsimError):
        run = stepped(solver, laws.path_profile, SAMPLES // 2)
        grid = replace(grid, ghost=stepped_ghost(solver, run))
    return grid


def slider_grids(solver: KinematicSolver, box: Box) -> list[PoseGrid]:
    """Return configurations on a grid over all drivers: one grid of up to three, or one grid each of more."""
    solver.mechanism.require_driver()
    drivers = solver.mechanism.drivers
    if len(drivers) <= max(NODES):
        return [_hand_grid(solver.mechanism, "move drivers", drivers, box, NODES[len(drivers)])]
    return [_hand_grid(solver.mechanism, f"move {name}", (name,), box, ALONE) for name in drivers]


def box_of(
    solver: KinematicSolver, limits: Mapping[str, tuple[float, float]], start: Mapping[str, float]
) -> Box:
    """Return the ranges of the drivers of a mechanism when moved by hand.

    Args:
        solver: the mechanism's solver.
        limits: joint -> its range, if a file states it.
        start: driver -> initial value, for drivers without a motion law.
    """
    begin, low, high = dict(start), dict[str, float](), dict[str, float]()
    spans: dict[str, tuple[float, float]] = {}
    times = np.linspace(0.0, solver.motion_laws.duration, 257)
    for name, state in solver.motion_laws.by_name.items():
        values = state(times)[0]
        spans[name] = float(np.min(values)), float(np.max(values))
    begin |= solver.motion_laws.first
    for name in solver.mechanism.drivers:
        unit = solver.mechanism.unit(name)
        least_range = MANUAL_RANGE[unit][len(solver.mechanism.drivers) > 2] * (
            1.0 if unit == "rad" else solver.mechanism.characteristic_length
        )
        least, most = spans.get(name, (begin[name], begin[name]))
        middle, reach = 0.5 * (least + most), max(0.75 * (most - least), least_range)
        if unit == "rad":
            reach = min(reach, np.pi)
        bounds = limits.get(name, (-np.inf, np.inf))
        low[name], high[name] = max(middle - reach, bounds[0]), min(middle + reach, bounds[1])
    return Box(begin, low, high)


def _hand_grid(mechanism: Mechanism, name: str, moved: Sequence[str], box: Box, count: int) -> PoseGrid:
    """Return the grid over some drivers, the others where they start; what cannot stand there is NaN.

    Row by row the last driver goes either way from where it starts, as far as its assembly can be followed.
    """
    nodes = [np.linspace(box.low[driver], box.high[driver], count) for driver in moved]
    shape, points = (count,) * len(moved), moving_points(mechanism)
    links = [link.name for link in with_rods(mechanism, {})[0].links]
    position = {link: np.full((*shape, 3), np.nan) for link in links}
    quaternion = {link: np.full((*shape, 4), np.nan) for link in links}
    point_positions = {point: np.full((*shape, 3), np.nan) for point in points}
    for index in product(range(count), repeat=len(moved) - 1):
        others = {driver: float(nodes[k][i]) for k, (driver, i) in enumerate(zip(moved, index, strict=False))}
        stand, motion = _row(mechanism, {**box.start, **others}, moved[-1], nodes[-1])
        if motion is None:
            continue
        for link, pose in moved_links(mechanism, motion).items():
            position[link][index][stand] = pose.position
            quaternion[link][index][stand] = quaternions(pose.rotation)
        for point in points:
            point_positions[point][index][stand] = motion.points[point].position
    sliders = tuple(
        Slider(driver, "m" if mechanism.unit(driver) == "m" else "rad", nodes[k], False, box.start[driver])
        for k, driver in enumerate(moved)
    )
    components = {
        point: dict(zip("xyz", np.moveaxis(coordinates, -1, 0), strict=True))
        for point, coordinates in point_positions.items()
    }
    readouts = tuple(Readout(point, "m", component) for point, component in components.items())
    grid = PoseGrid(name, sliders, position, quaternion, readouts)
    return replace(grid, error=_error(mechanism, grid, box))


def _error(mechanism: Mechanism, grid: PoseGrid, box: Box) -> float:
    """Return the largest position error of a link at settings between nodes that have poses, in [m]."""
    random, worst = np.random.default_rng(1), float("nan")
    *others, last = grid.sliders
    for _ in range(PROBED if others else 1):
        stands = {slider.name: float(random.uniform(slider.nodes[0], slider.nodes[-1])) for slider in others}
        along = np.sort(random.uniform(last.nodes[0], last.nodes[-1], PROBED))
        stand, motion = _row(mechanism, {**box.start, **stands}, last.name, along)
        if motion is None:
            continue
        for link, moved in motion.links.items():
            for value, expected in zip(along[stand].tolist(), moved.position, strict=True):
                approximate = interpolated(grid.sliders, grid.position[link], [*stands.values(), value])
                # next to a node without a pose the page shows nothing, or interpolates linearly
                worst = float(np.fmax(worst, np.linalg.norm(approximate - expected)))
    return worst


def _row(
    mechanism: Mechanism, values: Mapping[str, float], moved: str, nodes: Array
) -> tuple[NDArray[np.bool_], Motion | None]:
    """Return the nodes of a driver that can be reached with the others at rest, and the motion there."""
    states = {driver: steady(values[driver], 1.0 if driver == moved else 0.0) for driver in mechanism.drivers}
    parameter = nodes - values[moved]
    try:
        laws = make_motion_laws(mechanism, states, 1.0)
        path = driven_path(mechanism, laws)
    except AssemblyError:
        return np.zeros(len(nodes), dtype=np.bool_), None
    parameter = parameter * laws.rate
    ends = [_reached(path, direction, float(parameter[end])) for direction, end in ((-1, 0), (1, -1))]
    reachable = (parameter >= ends[0]) & (parameter <= ends[1])
    if not reachable.any():
        return reachable, None
    return reachable, solve_along(path, parameter[reachable], laws.rate, 0.0, laws)


def _reached(path: LoopPath, direction: int, end: float) -> float:
    """Return the path parameter up to which a path can be followed towards an end."""
    with suppress(AssemblyError):
        path.extend(end)
        return end
    segments = path.segments[direction]
    return float(segments[-1].nodes[-1]) if segments else 0.0
