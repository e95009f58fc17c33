"""Poses over the angle of one crank, denser towards dead centres, with marks and the ghost of a run."""

from dataclasses import replace

import numpy as np

from mechsim.analytic.catalog.base import SELECTORS, ClosedForm
from mechsim.analytic.forms import Form
from mechsim.errors import MechsimError
from mechsim.model.motion import Motion
from mechsim.model.motion_laws import arc_around, constant, within_range
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array
from mechsim.pictures.view import GhostTrack, Mark, PoseGrid, Readout, between, ghost_of, motion_grid
from mechsim.studies.motion_source import simulated

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
