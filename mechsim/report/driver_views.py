"""Poses of mechanisms with several drivers: over the time of their programs, and by hand within a box."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.loops.motion import driven_path, solve_along
from mechsim.analytic.loops.path import ContinuationPath
from mechsim.errors import AssemblyError, MechsimError
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion
from mechsim.model.motion_laws import make_motion_laws, steady
from mechsim.numerics.arrays import Array
from mechsim.pictures.view import (
    PoseGrid,
    Readout,
    Slider,
    SliderUnit,
    between,
    ghost_of,
    interpolated,
    motion_grid,
    quaternions,
)
from mechsim.studies.motion_source import simulated

# intervals of the time of programs
SAMPLES = 360
# nodes of each driver, by how many there are; more drivers are moved one at a time
NODES: Mapping[int, int] = {1: 121, 2: 25, 3: 7}
ALONE = 61
# how far a driver may be moved by hand either way, where no file says: in [rad], and as a part of the size;
# with three the whole box is to be far from singular, or following to its edges takes minutes
MANUAL_RANGE = {"rad": (np.deg2rad(45.0), np.deg2rad(20.0)), "m": (0.25, 0.1)}
# settings between nodes at which the error is measured: of the last driver, and of the others
PROBED = 6


@dataclass(frozen=True, slots=True)
class Box:
    """Where drivers stand at first, and how far each may go.

    Attributes:
        start: driver -> value in SI.
        low: driver -> least value.
        high: driver -> greatest value.
    """

    start: Mapping[str, float]
    low: Mapping[str, float]
    high: Mapping[str, float]


def motion_law_grid(solver: LoopForm) -> PoseGrid:
    """Return the poses over the time of the programs of a mechanism.

    Raises:
        AssemblyError: where the loops do not close on the way.
    """
    laws = solver.motion_laws
    times = np.linspace(0.0, laws.duration, SAMPLES + 1)
    motion = solver.solve(t=times)
    grid = motion_grid("as programmed", solver.mechanism, motion, driver="time", unit="s", nodes=times)
    middles = 0.5 * (times[:-1] + times[1:])[:: SAMPLES // 60]
    exact = solver.solve(t=middles)
    grid = replace(grid, error=between(grid, exact, middles))
    with suppress(MechsimError):
        run = simulated(solver, laws.path_profile, samples=SAMPLES // 2, method="step").motion
        if not run.broken and run.time is not None:
            grid = replace(
                grid, ghost=ghost_of("MuJoCo, stepped", solver.mechanism, solver.solve_as(run), run)
            )
    return grid


def hand_grids(solver: LoopForm, box: Box) -> list[PoseGrid]:
    """Return the poses over all drivers by hand: one grid of up to three, or one grid each of more."""
    drivers = solver.mechanism.drivers
    if len(drivers) <= max(NODES):
        return [_hand_grid(solver.mechanism, "by hand", drivers, box, NODES[len(drivers)])]
    return [_hand_grid(solver.mechanism, f"{name} by hand", (name,), box, ALONE) for name in drivers]


def box_of(solver: LoopForm, limits: Mapping[str, tuple[float, float]], start: Mapping[str, float]) -> Box:
    """Return how far the drivers of a mechanism may be moved by hand.

    Args:
        form: whose drivers.
        limits: joint -> its range, where a file states it.
        start: driver -> where it stands, where nothing is programmed.
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
            1.0 if unit == "rad" else solver.mechanism.size
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
    shape, points = (count,) * len(moved), _moving(mechanism)
    position = {link.name: np.full((*shape, 3), np.nan) for link in mechanism.links}
    quaternion = {link.name: np.full((*shape, 4), np.nan) for link in mechanism.links}
    point_positions = {point: np.full((*shape, 3), np.nan) for point in points}
    for index in product(range(count), repeat=len(moved) - 1):
        others = {driver: float(nodes[k][i]) for k, (driver, i) in enumerate(zip(moved, index, strict=False))}
        stand, motion = _row(mechanism, {**box.start, **others}, moved[-1], nodes[-1])
        if motion is None:
            continue
        for link in position:
            position[link][index][stand] = motion.links[link].position
            quaternion[link][index][stand] = quaternions(motion.links[link].rotation)
        for point in points:
            point_positions[point][index][stand] = motion.points[point].position
    sliders = tuple(
        Slider(driver, _unit(mechanism, driver), nodes[k], False, box.start[driver])
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


def _moving(mechanism: Mechanism) -> list[str]:
    return [name for name, (link, _) in mechanism.points.items() if link != GROUND]


def _row(
    mechanism: Mechanism, values: Mapping[str, float], moved: str, nodes: Array
) -> tuple[NDArray[np.bool_], Motion | None]:
    """Return which nodes of a driver can be reached, the others standing still, and the motion there."""
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


def _reached(path: ContinuationPath, direction: int, end: float) -> float:
    """Return how far a path can be followed towards an end, as a path parameter."""
    with suppress(AssemblyError):
        path.extend(end)
        return end
    segments = path.segments[direction]
    return float(segments[-1].nodes[-1]) if segments else 0.0


def _unit(mechanism: Mechanism, driver: str) -> SliderUnit:
    return "m" if mechanism.unit(driver) == "m" else "rad"
