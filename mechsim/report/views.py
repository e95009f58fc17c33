"""Views of a mechanism: poses of each assembly, of motion laws, of several drivers, of a validated run."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace

import numpy as np

from mechsim.analytic.catalog.base import SELECTORS, ClosedForm
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.loops.start import start_poses
from mechsim.errors import MechsimError
from mechsim.model.motion import Motion, taken
from mechsim.model.motion_laws import arc_around, constant, within_range
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.pictures.render.file_bodies import drawn_as
from mechsim.pictures.view import GhostTrack, Mark, PoseGrid, Readout, View, between, ghost_of, motion_grid
from mechsim.report.driver_views import box_of, hand_grids, program_grid
from mechsim.studies.motion_source import simulated
from mechsim.studies.validate import Case
from mechsim.theory.continuation import AssemblyCurve, even_motion, trace

# intervals of a turn, and of an arc that the crank swings over
SAMPLES = 360
# how near to a dead centre a swing goes, as a part of its arc: rates have no bound at the very end
KEPT_OFF = 1e-6
# cells in whose middles the error between poses is measured
PROBED = 60
# crank angles at which all assemblies of a closed form are asked for
ASKED = 12


def crank_grids(form: Form, speed: float, limits: tuple[float, float] | None = None) -> list[PoseGrid]:
    """Return the grid of each assembly that is known without a search, the form's own first.

    Args:
        form: with a crank.
        speed: of the crank in [rad/s].
        limits: of its angle in [rad], where a file tells them.

    Raises:
        AssemblyError: where its own assembly can stand nowhere.
    """
    if not isinstance(form, ClosedForm):
        # by hand it goes everywhere that the crank's own range lets it
        return [crank_grid(replace(form, ranges={}), "own assembly", speed, limits)]
    return [crank_grid(one, _called(one), speed, limits) for one in (form, *_others(form))]


def crank_grid(form: Form, name: str, speed: float, limits: tuple[float, float] | None) -> PoseGrid:
    """Return the poses of one assembly over the arc that its crank can turn through."""
    angles, middles = _angles(form, limits)
    form = form.starting_at(angles)
    motion = form.solve_along(angles, speed)
    extra: list[Readout] = []
    marks = marks_of(form)
    if isinstance(form, ClosedForm):
        transmission = form.transmission_angle(angles)
        extra.append(Readout("transmission angle", "rad", {"": transmission}))
        least = int(np.argmin(transmission))
        marks.append(
            Mark(float(angles[least]), f"least transmission, {np.rad2deg(transmission[least]):.1f}°")
        )
    grid = motion_grid(
        name,
        form.mechanism,
        motion,
        driver=form.mechanism.crank.name,
        marks=[one for mark in marks for one in lapped(mark, angles)],
        extra=extra,
        ghost=_ghost(form, speed),
    )
    return replace(grid, error=between(grid, form.solve_along(middles, speed), middles))


def _others(form: ClosedForm) -> list[ClosedForm]:
    """Return the other assemblies that stand at some crank angle."""
    known, found = {_called(form)}, list[ClosedForm]()
    for angle in np.linspace(-np.pi, np.pi, ASKED, endpoint=False).tolist():
        for one in form.assemblies(angle):
            if _called(one) not in known:
                known.add(_called(one))
                found.append(one)
    return found


def _angles(form: Form, limits: tuple[float, float] | None) -> tuple[Array, Array]:
    """Return the crank angles that are solved, and some in the middle between them."""
    arcs, samples = form.crank_range(), SAMPLES
    if arcs.full and limits is None:
        turns = max(1, round(form.period / TURN))
        low, high, samples = 0.0, turns * TURN, samples * turns
        share = np.linspace(0.0, 1.0, samples + 1)
    else:
        start = form.mechanism.start
        around = (start - TURN, start + TURN) if arcs.full else arc_around(arcs, start) or (start, start)
        low, high = (
            around[0] + KEPT_OFF * (around[1] - around[0]),
            around[1] - KEPT_OFF * (around[1] - around[0]),
        )
        if limits is not None:
            low, high = max(low, limits[0]), min(high, limits[1])
        # near a dead centre poses go as the root of the angle: even steps of a circle are even steps there
        share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, samples + 1))
    angles = low + share * (high - low)
    cells = np.unique(np.linspace(0, samples - 1, PROBED).astype(int))
    return angles, 0.5 * (angles[cells] + angles[cells + 1])


def marks_of(form: Form) -> list[Mark]:
    """Return the dead centres of a crank and where assemblies meet."""
    marks = [Mark(at, "dead centre", "dead") for at in form.dead_centres()]
    return marks + [Mark(at, "assemblies meet", "meets") for at in form.change_points()]


def lapped(mark: Mark, angles: Array) -> list[Mark]:
    """Return a mark counted on the laps of the slider; none where it lies beyond."""
    low, high = float(angles[0]), float(angles[-1])
    near = 1e-3 * (high - low)
    first = mark.at - TURN * np.floor((mark.at - low + near) / TURN)
    laps = np.arange(first, high + near, TURN).tolist()
    return [replace(mark, at=float(np.clip(at, low, high))) for at in laps]


def _ghost(form: Form, speed: float) -> GhostTrack | None:
    """Return where MuJoCo's stepped run puts the links, over rising angles; None where it cannot run."""
    try:
        arcs = form.crank_range()
        profile = constant(speed, 1.0) if arcs.full else within_range(form.mechanism, arcs, speed)
        run = simulated(form, profile, samples=SAMPLES // 2, method="step").motion
    except MechsimError:
        return None
    if run.broken or len(run) < SAMPLES // 2:
        return None
    rows = slice(0, 1 + int(np.argmax(run.angle)))
    return ghost_of("MuJoCo, stepped", form.mechanism, _exact(form, run), run, rows)


def _exact(form: Form, run: Motion) -> Motion:
    if isinstance(form, ClosedForm):
        return form.solve_along(run.angle, run.speed, run.acceleration)
    return form.solve_as(run)


def _called(form: ClosedForm) -> str:
    """Return what an assembly is called: by the parameters that select it."""
    chosen = [f"{name} {getattr(form, name)}" for name in SELECTORS if hasattr(form, name)]
    return ", ".join(chosen) or "its assembly"


# random starts from which curves are sought
STARTS = 60
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


# of a scene that says where it starts
NOT_SOUGHT = "Other assemblies than that in which the file starts were not sought."


def mechanism_view(form: Form, speed: float, limits: Mapping[str, tuple[float, float]] | None = None) -> View:
    """Return what a page shows of a mechanism.

    Args:
        form: what moves.
        speed: of its crank in [rad/s], for speeds and for the run that is the ghost.
        limits: joint -> its range in SI, where a file of MJCF tells it; its other assemblies are not sought.

    Raises:
        AssemblyError: where it can stand nowhere.
    """
    searched, limits = limits is None, limits or {}
    road = "closed form" if isinstance(form, ClosedForm) else "loop equations"
    if form.mechanism.has_crank and form.motion_laws is None:
        grids = crank_grids(form, speed, limits.get(form.mechanism.crank.name))
        others, said = curve_grids(form) if searched else ([], NOT_SOUGHT)
        facts = [f"Solved by its {road}; speeds are at a crank speed of {speed * 60.0 / TURN:g} rpm.", said]
        return _view(form, [*grids, *others], facts)
    assert isinstance(form, LoopForm)
    start = start_poses(form.mechanism)[1]
    by_hand = hand_grids(form, box_of(form, limits, start))
    programmed = [] if form.motion_laws is None else [program_grid(form)]
    return _view(form, [*programmed, *by_hand], ["Solved by its loop equations."])


def _view(form: Form, grids: list[PoseGrid], facts: list[str]) -> View:
    said = [line for line in facts if line]
    return View(form.mechanism, grids, form.name.replace("_", "-"), said, **drawn_as(form))


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
