"""What a page to turn by hand shows of a mechanism: motions solved for it, assembly by assembly."""

from dataclasses import replace

import numpy as np

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.forms import Form
from mechsim.maths.angles import TURN
from mechsim.maths.arrays import Array
from mechsim.model.crank_profile import arc_around
from mechsim.model.motion import Motion
from mechsim.pictures.view import GhostTrack, Mark, PoseGrid, Readout, View, ghost_of, motion_grid
from mechsim.pictures.view.gathering import between
from mechsim.studies.motion_source import profile_of, simulated

# intervals of a turn, and of an arc that the crank swings over
SAMPLES = 360
# how near to a dead centre a swing goes, as a part of its arc: rates have no bound at the very end
KEPT_OFF = 1e-6
# cells in whose middles the error between poses is measured
PROBED = 60


def mechanism_view(form: Form, speed: float) -> View:
    """Return what a page shows of a mechanism.

    Args:
        form: what moves.
        speed: of its crank in [rad/s], for speeds and for the run that is the ghost.

    Raises:
        AssemblyError: where it can stand nowhere.
    """
    own = _crank_grid(form, "own" if not isinstance(form, ClosedForm) else _called(form), speed)
    road = "closed form" if isinstance(form, ClosedForm) else "loop equations"
    facts = [f"Solved by its {road}; speeds are at a crank speed of {speed * 60.0 / TURN:g} rpm."]
    return View(form.mechanism, [own], form.name.replace("_", "-"), facts)


def _crank_grid(form: Form, name: str, speed: float) -> PoseGrid:
    """Return the poses over the arc of one assembly, denser towards dead centres, with all that is known."""
    angles, middles = _angles(form)
    motion = form.solve(angles, speed)
    extra: list[Readout] = []
    marks = _marks(form)
    if isinstance(form, ClosedForm):
        transmission = form.transmission_angle(angles)
        extra.append(Readout("transmission angle", "rad", {"": transmission}))
        least = int(np.argmin(transmission))
        marks.append(Mark(float(angles[least]), "least transmission angle"))
    driver = form.mechanism.crank.name
    grid = motion_grid(
        name,
        form.mechanism,
        motion,
        driver=driver,
        marks=[_lapped(mark, angles) for mark in marks],
        extra=extra,
        ghost=_ghost(form, speed),
    )
    return replace(grid, error=between(grid, form.solve(middles, speed), middles))


def _angles(form: Form) -> tuple[Array, Array]:
    """Return the crank angles that are solved, and some in the middle between them."""
    arcs = form.crank_range()
    samples = SAMPLES
    if arcs.full:
        turns = max(1, round(form.period / TURN))
        low, high, samples = 0.0, turns * TURN, samples * turns
        share = np.linspace(0.0, 1.0, samples + 1)
    else:
        around = arc_around(arcs, form.mechanism.start)
        low, high = around or (form.mechanism.start, form.mechanism.start)
        low, high = low + KEPT_OFF * (high - low), high - KEPT_OFF * (high - low)
        # near a dead centre poses go as the root of the angle: even steps of a circle are even steps there
        share = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, samples + 1))
    angles = low + share * (high - low)
    cells = np.unique(np.linspace(0, samples - 1, PROBED).astype(int))
    return angles, 0.5 * (angles[cells] + angles[cells + 1])


def _marks(form: Form) -> list[Mark]:
    marks = [Mark(at, "dead centre", "dead") for at in form.dead_centres()]
    return marks + [Mark(at, "assemblies meet", "meets") for at in form.change_points()]


def _lapped(mark: Mark, angles: Array) -> Mark:
    """Return a mark counted on the lap of the slider."""
    low = float(angles[0])
    lap = TURN * np.floor((mark.at - low + 1e-3) / TURN)
    return replace(mark, at=float(np.clip(mark.at - lap, low, angles[-1])))


def _ghost(form: Form, speed: float) -> GhostTrack | None:
    """Return where MuJoCo's stepped run puts the links, over the slider's angles."""
    profile = profile_of(form, speed, 1.0)
    run = simulated(form, profile, samples=SAMPLES // 2, method="step").motion
    exact = _exact(form, run)
    return ghost_of("MuJoCo, stepped", form.mechanism, exact, run)


def _exact(form: Form, run: Motion) -> Motion:
    if isinstance(form, ClosedForm):
        return form.solve(run.angle, run.speed, run.acceleration)
    return form.solve_as(run)


def _called(form: ClosedForm) -> str:
    """Return what an assembly is called: by the parameters that select it."""
    chosen = [
        f"{name} {getattr(form, name)}" for name in ("branch", "side", "assembly") if hasattr(form, name)
    ]
    return ", ".join(chosen) or "assembly"
