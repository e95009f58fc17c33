"""Views of mechanisms: each assembly, motion laws, drivers moved by hand, runs, modes, validated motions."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from itertools import pairwise

import numpy as np

from mechsim.errors import AssemblyError, MechsimError
from mechsim.io.model_source import ModelSource
from mechsim.kinematics.designs import DesignFamily
from mechsim.kinematics.loops.motion import driven_path, solve_along
from mechsim.kinematics.loops.path import LoopPath
from mechsim.kinematics.loops.start import start_poses
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.links import GROUND, Pose
from mechsim.mechanism.masses import summary
from mechsim.mechanism.mechanism import Mechanism, Up
from mechsim.mechanism.motion import Motion, select_instants
from mechsim.mechanism.motion_laws import interval_around, make_motion_laws, steady, within_range
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.graphs import components
from mechsim.pictures.render.drawn_model import drawn_as
from mechsim.pictures.view import pose_grid
from mechsim.pictures.view.pose_grid import GhostTrack, Landmark, PoseGrid, Readout, View, motion_grid
from mechsim.studies.drawn_motion import stepped
from mechsim.studies.release import Release
from mechsim.studies.scene.own_settings import runs_as_published
from mechsim.studies.validate import Validation

# intervals of a turn, of an arc that the crank swings over, of the time of motion laws
SAMPLES = 360
# how near to a dead centre a swing goes, as a part of its arc: rates have no bound at the very end
KEPT_OFF = 1e-6
# crank angles at which all assemblies of a closed form are asked for
CRANK_ANGLES = 12


def crank_grids(
    solver: KinematicSolver, speed: float, limits: tuple[float, float] | None = None
) -> list[PoseGrid]:
    """Return the grid of each assembly that is known without a search, the form's own first.

    Args:
        solver: with a crank.
        speed: of the crank in [rad/s].
        limits: of its angle in [rad], where a file states them.

    Raises:
        AssemblyError: if this assembly mode closes at no crank angle.
    """
    if solver.assemblies(solver.crank_range().start()) is None:
        # the slider covers the crank's whole range
        free = solver.with_mechanism(solver.mechanism, ranges={}) if solver.ranges else solver
        return [crank_grid(free, "own assembly", speed, limits)]
    assemblies = {_called(solver): solver}
    for angle in np.linspace(-np.pi, np.pi, CRANK_ANGLES, endpoint=False).tolist():
        for assembly in solver.assemblies(angle) or ():
            assemblies.setdefault(_called(assembly), assembly)
    return [crank_grid(assembly, name, speed, limits) for name, assembly in assemblies.items()]


def crank_grid(
    solver: KinematicSolver, name: str, speed: float, limits: tuple[float, float] | None
) -> PoseGrid:
    """Return the poses of one assembly over the arc that its crank can turn through."""
    angles = _angles(solver, limits)
    solver = solver.starting_at(angles)
    motion = solver.solve_along(angles, speed)
    extra, landmarks = list[Readout](), landmarks_of(solver)
    transmission = solver.transmission_angle(angles)
    if transmission is not None:
        extra.append(Readout("transmission angle", "rad", {"": transmission}))
        least = int(np.argmin(transmission))
        label = f"least transmission angle {np.rad2deg(transmission[least]):.1f}°"
        landmarks.append(Landmark(float(angles[least]), label))
    driver, landmarks = solver.mechanism.crank.name, repeated_landmarks(landmarks, angles)
    grid = motion_grid(name, solver.mechanism, motion, driver=driver, landmarks=landmarks, extra=extra)
    start = float(solver.mechanism.start)
    if not angles[0] <= start <= angles[-1]:
        start = angles[0] + (start - angles[0]) % REVOLUTION
    slider = replace(grid.slider, start=float(np.clip(start, angles[0], angles[-1])))
    return replace(grid, slider=slider, ghost=_ghost(solver, speed))


def _angles(solver: KinematicSolver, limits: tuple[float, float] | None) -> Array:
    """Return the crank angles that are solved."""
    arcs, samples = solver.crank_range(), SAMPLES
    if arcs.full and limits is None:
        turns = max(1, round(solver.period / REVOLUTION))
        low, high, samples = 0.0, turns * REVOLUTION, samples * turns
        share = np.linspace(0.0, 1.0, samples + 1)
    else:
        start = solver.mechanism.start
        low, high = start - REVOLUTION, start + REVOLUTION
        if not arcs.full:
            low, high = interval_around(arcs, start) or (start, start)
        low, high = low + KEPT_OFF * (high - low), high - KEPT_OFF * (high - low)
        if limits is not None:
            low, high = max(low, limits[0]), min(high, limits[1])
        # near a dead centre poses go as the root of the angle: even steps of a circle are even steps there
        share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, samples + 1))
    return low + share * (high - low)


def landmarks_of(solver: KinematicSolver) -> list[Landmark]:
    """Return the dead centres of a crank and where assemblies meet."""
    landmarks = [Landmark(angle, "dead centre", "dead") for angle in solver.dead_centres()]
    return landmarks + [Landmark(angle, "assemblies meet", "meets") for angle in solver.change_points()]


def repeated_landmarks(landmarks: Iterable[Landmark], angles: Array) -> list[Landmark]:
    """Return landmarks in every revolution of the slider; none outside its range."""
    low, high = float(angles[0]), float(angles[-1])
    slack = 1e-3 * (high - low)
    repeated: list[Landmark] = []
    for landmark in landmarks:
        first = landmark.value - REVOLUTION * np.floor((landmark.value - low + slack) / REVOLUTION)
        values = np.arange(first, high + slack, REVOLUTION).clip(low, high).tolist()
        repeated += [replace(landmark, value=value) for value in values]
    return repeated


def _ghost(solver: KinematicSolver, speed: float) -> GhostTrack | None:
    """Return where MuJoCo's stepped run puts the links, over rising angles; None where it cannot run."""
    try:
        profile = within_range(solver.mechanism, solver.crank_range(), speed)
        run = stepped(solver, profile, SAMPLES // 2)
    except MechsimError:
        return None
    return None if len(run) < SAMPLES // 2 else stepped_ghost(solver, run)


def _called(solver: KinematicSolver) -> str:
    """Return what an assembly is called: by the parameters that select it."""
    return ", ".join([f"{name} {value}" for name, value in solver.selectors.items()]) or "its assembly"


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
    return None if run.broken else pose_grid.ghost_of(name, solver.mechanism, solver.solve_as(run), run)


# range of a driver moved by hand to either side without limits of a file: in [rad], and relative to the size
MANUAL_ANGLE, MANUAL_LENGTH = np.deg2rad(45.0), 0.25
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
        grid = replace(grid, ghost=stepped_ghost(solver, stepped(solver, laws.path_profile, SAMPLES // 2)))
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
    mechanism = solver.mechanism
    mechanism.require_driver()
    begin, groups = {**start, **solver.motion_laws.first}, connected_links(mechanism)
    if len(groups) == 1:
        return [_hand_grid(solver, name, mechanism, begin, limits) for name in mechanism.drivers]
    # only the links that are connected with a driver move with it
    laws = make_motion_laws(mechanism, {name: steady(begin[name], 1.0) for name in mechanism.drivers}, 1.0)
    motion = solve_along(driven_path(mechanism, laws), np.zeros(1), laws.rate, 0.0, laws)
    rest = motion_grid("rest", mechanism, motion, nodes=np.zeros(1), driver="", speeds=False)
    grids: list[PoseGrid] = []
    for name in mechanism.drivers:
        links = next(group for group in groups if {*mechanism.joint_with(name)[0].links} - {GROUND} <= group)
        connected = mechanism_of(mechanism, links, motion)
        grids.append(pose_grid.with_resting(_hand_grid(solver, name, connected, begin, limits), rest))
    return grids


def connected_links(mechanism: Mechanism) -> list[set[str]]:
    """Return the groups of moving links that joints and couplings connect other than by the frame."""
    of_coordinate = {name: joint.links for joint in mechanism.joints for name in joint.coordinates}
    tied = [joint.links for joint in mechanism.joints]
    tied += [
        tuple(link for name in law.coordinates for link in of_coordinate[name]) for law in mechanism.laws
    ]
    moving = [[link for link in links if link != GROUND] for links in tied]
    return components(mechanism.link_names[1:], [pair for links in moving for pair in pairwise(links)])


def mechanism_of(mechanism: Mechanism, links: set[str], motion: Motion) -> Mechanism:
    """Return a mechanism of some links and of the joints between them, in the first pose of a motion."""
    joints = tuple(joint for joint in mechanism.joints if {*joint.links} - {GROUND} <= links)
    coordinates = {name for joint in joints for name in joint.coordinates}
    drivers = tuple(name for name in mechanism.drivers if name in coordinates)
    values = {name: float(joint.value[0]) for name, joint in motion.joints.items() if name in coordinates}
    poses = {name: Pose(motion.links[name].position[0], motion.links[name].rotation[0]) for name in links}
    names = {joint.name for joint in joints}
    return replace(
        mechanism,
        links=tuple(link for link in mechanism.links if link.name in links),
        joints=joints,
        driver=drivers,
        points={name: point for name, point in mechanism.points.items() if point[0] in links},
        gears=tuple(gear for gear in mechanism.gears if {gear.driver, gear.driven} <= names),
        guess=poses,
        start=values.get(drivers[0], 0.0),
        couplings=tuple(each for each in mechanism.couplings if {*each.coordinates} <= coordinates),
        locked={name: value for name, value in mechanism.locked.items() if name in coordinates},
        guess_coordinates=values,
        contacts={name: contact for name, contact in mechanism.contacts.items() if name in names},
    )


def _hand_grid(
    solver: KinematicSolver,
    moved: str,
    mechanism: Mechanism,
    start: Mapping[str, float],
    limits: Mapping[str, tuple[float, float]],
) -> PoseGrid:
    """Return the poses over one driver of a mechanism, the others where they start.

    Its range is half as large again as that of its motion law, within its limits.
    """
    laws, values = solver.motion_laws, np.array([start[moved]])
    angle = mechanism.unit(moved) == "rad"
    if moved in laws.by_name:
        values = laws.by_name[moved](np.linspace(0.0, laws.duration, 257))[0]
    middle, reach = float(0.5 * (np.min(values) + np.max(values))), 0.75 * float(np.ptp(values))
    least = MANUAL_ANGLE if angle else MANUAL_LENGTH * mechanism.characteristic_length
    reach = min(max(reach, least), np.pi if angle else np.inf)
    states = {driver: steady(start[driver], 1.0 if driver == moved else 0.0) for driver in mechanism.drivers}
    laws = make_motion_laws(mechanism, states, 1.0)
    path = driven_path(mechanism, laws)
    least, most = limits.get(moved, (-np.inf, np.inf))
    low, high = max(middle - reach, least), min(middle + reach, most)
    ends = [(end - start[moved]) * laws.rate for end in (low, high)]
    parameter = np.linspace(_reached(path, -1, ends[0]), _reached(path, 1, ends[1]), SAMPLES + 1)
    motion = solve_along(path, parameter, laws.rate, 0.0, laws)
    unit, nodes = "rad" if angle else "m", start[moved] + parameter / laws.rate
    grid = motion_grid(f"move {moved}", mechanism, motion, nodes=nodes, driver=moved, unit=unit, speeds=False)
    return replace(grid, slider=replace(grid.slider, start=start[moved]))


def _reached(path: LoopPath, direction: int, end: float) -> float:
    """Return the path parameter up to which a path is shown towards an end: short of a singular pose."""
    try:
        path.extend(end)
    except AssemblyError:
        return KEPT_SHORT * path.end(direction)
    return end


# solved motions that a live page holds besides its solver, so that it stays below 1.5 MB
LIVE_GRIDS = 3


def model_view(solver: KinematicSolver, speed: float, up: Up | None = None) -> View:
    """Return what a page shows of a loaded model, with the joint limits of its MJCF file."""
    limits = None if solver.source is None else solver.ranges
    return replace(mechanism_view(solver, speed, limits), up=up)


def live_view(
    view: View, source: ModelSource, solver: KinematicSolver, designs: DesignFamily, speed: float
) -> View:
    """Return a page that also solves its mechanism, so that dimensions vary and points can be dragged.

    Args:
        view: what it shows else.
        source: the opened model.
        solver: its mechanism.
        designs: its dimensions.
        speed: of a single driven angle in [rad/s].

    Raises:
        AssemblyError, MobilityError, InputError: as `live_page`.
    """
    from mechsim.report.live_page import live_page

    return replace(view, grids=view.grids[:LIVE_GRIDS], live=live_page(source, solver, designs, speed))


def mechanism_view(
    solver: KinematicSolver, speed: float, limits: Mapping[str, tuple[float, float]] | None = None
) -> View:
    """Return what a page shows of a mechanism.

    Args:
        solver: what moves.
        speed: of its crank in [rad/s], for speeds and for the run that is the ghost.
        limits: joint -> its range in SI, where an MJCF file states it.

    Raises:
        AssemblyError: where it closes nowhere.
    """
    limits = limits or {}
    if solver.mechanism.has_crank and solver.motion_laws.crank:
        grids = crank_grids(solver, speed, limits.get(solver.mechanism.crank.name))
        fact = (
            f"Solved by its {solver.method}; speeds are at a crank speed of "
            f"{speed * 60.0 / REVOLUTION:g} rpm; `mechsim trace` finds other assemblies."
        )
    else:
        timed = [] if solver.motion_laws.crank else [motion_law_grid(solver)]
        grids = [*timed, *hand_grids(solver, limits, start_poses(solver.mechanism)[1])]
        fact = "Solved by its loop equations."
    return View(solver.mechanism, grids, solver.name, [fact], **drawn_as(solver))


def case_view(case: Validation) -> View | None:
    """Return what a page shows of a validation; None of a motion without links."""
    solver, motion = case.solver, case.exact
    if not motion.links:
        return None
    shown = select_instants(motion, pose_grid.ascending(motion))
    if motion.drivers and shown.time is not None:
        grid = motion_grid("judged", solver.mechanism, shown, driver="time", unit="s", nodes=shown.time)
    else:
        landmarks, driver = repeated_landmarks(landmarks_of(solver), shown.angle), solver.mechanism.crank.name
        grid = motion_grid("judged", solver.mechanism, shown, driver=driver, landmarks=landmarks)
    if not case.quick:
        with suppress(MechsimError):
            grid = replace(grid, ghost=stepped_ghost(solver, case.run.motion))
    fact = f"The motion that was judged: {motion.source}, {len(shown)} poses, verdict {case.verdict.outcome}."
    return View(solver.mechanism, [grid], solver.name, [fact], **drawn_as(solver))
