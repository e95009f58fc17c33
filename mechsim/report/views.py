"""Views of a mechanism: poses of each assembly, of motion laws, of several drivers, of a validated run."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from mechsim.errors import MechsimError
from mechsim.io.model_source import ModelSource
from mechsim.kinematics.designs import DesignFamily
from mechsim.kinematics.loops.start import start_poses
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.mechanism import Up
from mechsim.mechanism.motion import select_instants
from mechsim.mechanism.motion_laws import constant, interval_around, within_range
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.pictures.render.drawn_model import drawn_as
from mechsim.pictures.view.pose_grid import (
    GhostTrack,
    Landmark,
    PoseGrid,
    Readout,
    View,
    ascending,
    motion_grid,
)
from mechsim.report.driver_views import (
    hand_grids,
    motion_law_grid,
    stepped_ghost,
)
from mechsim.studies.drawn_motion import stepped
from mechsim.studies.validate import Validation

# intervals of a turn, and of an arc that the crank swings over
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
        free = solver.with_mechanism(solver.mechanism, ranges={})
        return [crank_grid(free, "own assembly", speed, limits)]
    return [crank_grid(assembly, _called(assembly), speed, limits) for assembly in (solver, *_others(solver))]


def crank_grid(
    solver: KinematicSolver, name: str, speed: float, limits: tuple[float, float] | None
) -> PoseGrid:
    """Return the poses of one assembly over the arc that its crank can turn through."""
    angles = _angles(solver, limits)
    solver = solver.starting_at(angles)
    motion = solver.solve_along(angles, speed)
    extra: list[Readout] = []
    landmarks = landmarks_of(solver)
    transmission = solver.transmission_angle(angles)
    if transmission is not None:
        extra.append(Readout("transmission angle", "rad", {"": transmission}))
        least = int(np.argmin(transmission))
        landmarks.append(
            Landmark(float(angles[least]), f"least transmission angle {np.rad2deg(transmission[least]):.1f}°")
        )
    grid = motion_grid(
        name,
        solver.mechanism,
        motion,
        driver=solver.mechanism.crank.name,
        landmarks=repeated_landmarks(landmarks, angles),
        extra=extra,
    )
    start = float(solver.mechanism.start)
    if not angles[0] <= start <= angles[-1]:
        start = angles[0] + (start - angles[0]) % REVOLUTION
    slider = replace(grid.slider, start=float(np.clip(start, angles[0], angles[-1])))
    return replace(grid, slider=slider, ghost=_ghost(solver, speed))


def _others(solver: KinematicSolver) -> list[KinematicSolver]:
    """Return the other assemblies that stand at some crank angle."""
    names, assemblies = {_called(solver)}, list[KinematicSolver]()
    for angle in np.linspace(-np.pi, np.pi, CRANK_ANGLES, endpoint=False).tolist():
        for assembly in solver.assemblies(angle) or ():
            if _called(assembly) not in names:
                names.add(_called(assembly))
                assemblies.append(assembly)
    return assemblies


def _angles(solver: KinematicSolver, limits: tuple[float, float] | None) -> Array:
    """Return the crank angles that are solved."""
    arcs, samples = solver.crank_range(), SAMPLES
    if arcs.full and limits is None:
        turns = max(1, round(solver.period / REVOLUTION))
        low, high, samples = 0.0, turns * REVOLUTION, samples * turns
        share = np.linspace(0.0, 1.0, samples + 1)
    else:
        start = solver.mechanism.start
        around = (
            (start - REVOLUTION, start + REVOLUTION)
            if arcs.full
            else interval_around(arcs, start) or (start, start)
        )
        low, high = (
            around[0] + KEPT_OFF * (around[1] - around[0]),
            around[1] - KEPT_OFF * (around[1] - around[0]),
        )
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
        arcs = solver.crank_range()
        profile = constant(speed, 1.0) if arcs.full else within_range(solver.mechanism, arcs, speed)
        run = stepped(solver, profile, SAMPLES // 2)
    except MechsimError:
        return None
    return None if len(run) < SAMPLES // 2 else stepped_ghost(solver, run)


def _called(solver: KinematicSolver) -> str:
    """Return what an assembly is called: by the parameters that select it."""
    chosen = [f"{name} {value}" for name, value in solver.selectors.items()]
    return ", ".join(chosen) or "its assembly"


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
        facts = [
            f"Solved by its {solver.method}; speeds are at a crank speed of "
            f"{speed * 60.0 / REVOLUTION:g} rpm; `mechsim trace` finds other assemblies.",
        ]
        return _view(solver, grids, facts)
    start = start_poses(solver.mechanism)[1]
    by_hand = hand_grids(solver, limits, start)
    programmed = [] if solver.motion_laws.crank else [motion_law_grid(solver)]
    return _view(solver, [*programmed, *by_hand], ["Solved by its loop equations."])


def _view(solver: KinematicSolver, grids: list[PoseGrid], facts: list[str]) -> View:
    lines = [line for line in facts if line]
    return View(solver.mechanism, grids, solver.name, lines, **drawn_as(solver))


def case_view(case: Validation) -> View | None:
    """Return what a page shows of a validation; None of a motion without links."""
    solver, motion = case.solver, case.exact
    if not motion.links:
        return None
    shown = select_instants(motion, ascending(motion))
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
