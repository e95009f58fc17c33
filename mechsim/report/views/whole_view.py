"""What a page shows of a mechanism as a whole."""

from collections.abc import Mapping

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.analytic.loops.start import start_poses
from mechsim.numerics.angles import TURN
from mechsim.pictures.render.file_bodies import drawn_as
from mechsim.pictures.view import PoseGrid, View
from mechsim.report.views.crank_grids import crank_grids
from mechsim.report.views.curve_grids import curve_grids
from mechsim.report.views.driver_grids import box_of, hand_grids, program_grid

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
