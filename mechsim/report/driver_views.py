"""Views of mechanisms with several drivers, of runs from an initial state and of modes of vibration."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.maximal_coordinates import equations, scaled
from mechsim.analytic.loops.motion import driven_path, solve_along
from mechsim.analytic.loops.path import LoopPath
from mechsim.analytic.loops.start import start_poses
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import AssemblyError, MechsimError
from mechsim.model.joint_kinds import KINDS
from mechsim.model.link_poses import moved_links, with_rods
from mechsim.model.links import GROUND, ORIGIN, Pose, Vector
from mechsim.model.masses import summary
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion import Motion, select_instants
from mechsim.model.motion_laws import make_motion_laws, steady
from mechsim.model.quantities import moving_points
from mechsim.numerics.arrays import Array
from mechsim.numerics.rank import null_spaces, rank
from mechsim.pictures.render.drawn_model import drawn_as
from mechsim.pictures.view.pose_grid import (
    POSE_COORDINATES,
    GhostTrack,
    PlatformDrive,
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
from mechsim.studies.scene.published_run import runs_as_published

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


# smallest singular value, relative to the largest, of coordinates that count as independent: rotations are
# compared with displacements relative to the mechanism's size
INDEPENDENT = 1e-3
# largest angle about y in [rad] at the start: at pi/2 the angles about x and z are not unique
LARGEST_TILT = np.deg2rad(80.0)


def platform_of(mechanism: Mechanism, limits: Mapping[str, tuple[float, float]]) -> PlatformDrive | None:
    """Return the platform of a mechanism; None without one.

    The platform is the link with most joints among those not hinged to the ground that all drivers together
    move, with as many independent pose coordinates as there are drivers. Links next to the ground follow.

    Args:
        mechanism: with several drivers and no couplings or locked joints, else it has none.
        limits: driver -> lowest and highest value in SI, if a file states them.
    """
    drivers = mechanism.drivers
    simple = not (mechanism.laws or mechanism.locked) and all(
        KINDS[joint.kind].single for joint in mechanism.driven_joints
    )
    if len(drivers) < 2 or not simple:
        return None
    with suppress(AssemblyError):
        poses = start_poses(mechanism)[0]
        # independent free motions of all links, (k, 6 links), lengths relative to the size
        stacked = {name: Pose(pose.position[None], pose.rotation[None]) for name, pose in poses.items()}
        jacobian = equations(mechanism, stacked, None).jacobian
        motions = null_spaces(scaled(mechanism, jacobian)[0])[1]
        for link in _candidates(mechanism):
            origin, point = _reference_point(mechanism, link)
            coordinates = _controlled(mechanism, link, poses[link], point, motions)
            if len(coordinates) == len(drivers):
                return PlatformDrive(link, point, origin, coordinates, poses, limits)
    return None


def _candidates(mechanism: Mechanism) -> list[str]:
    """Return the moving links, those not joined to the ground first, those with most joints before others."""
    grounded = {
        link
        for joint in mechanism.joints
        for link in (joint.a.link, joint.b.link)
        if GROUND in (joint.a.link, joint.b.link)
    }
    return sorted(
        (link.name for link in mechanism.links),
        key=lambda link: (link in grounded and not _named(mechanism, link), -len(mechanism.ends(link))),
    )


def _named(mechanism: Mechanism, link: str) -> bool:
    return any(own == link for own, _ in mechanism.points.values())


def _reference_point(mechanism: Mechanism, link: str) -> tuple[str, Vector]:
    """Return name and position in [m] of the reference point of a link: pivot, origin or named point."""
    for joint in mechanism.joints:
        for end, other in ((joint.a, joint.b), (joint.b, joint.a)):
            if KINDS[joint.kind].pivot and (end.link, other.link) == (link, GROUND):
                return joint.name, end.point
    points = {name: point for name, (own, point) in mechanism.points.items() if own == link}
    at_origin = not points or ORIGIN in points.values()
    return (link, ORIGIN) if at_origin else next(iter(points.items()))


def _controlled(
    mechanism: Mechanism, link: str, pose: Pose, point: Vector, motions: Array
) -> tuple[str, ...]:
    """Return the independent pose coordinates of a link; none if its tilt is too large for angles."""
    if abs(np.arcsin(np.clip(pose.rotation[0, 2], -1.0, 1.0))) > LARGEST_TILT:
        return ()
    slot = 6 * [other.name for other in mechanism.links].index(link)
    linear, angular = motions[:, slot : slot + 3], motions[:, slot + 3 : slot + 6]
    arm = pose.rotation @ np.asarray(point) / mechanism.characteristic_length
    rates = np.hstack([linear + np.cross(angular, arm), angular])  # (k, 6)
    chosen: list[int] = []
    for index in range(len(POSE_COORDINATES)):
        if rank(rates[:, [*chosen, index]], INDEPENDENT, INDEPENDENT) > len(chosen):
            chosen.append(index)
    return tuple(POSE_COORDINATES[index] for index in chosen)


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
