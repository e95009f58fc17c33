"""Command `mechsim view`: an interactive 3-D page of a mechanism."""

import os
import sys
import tempfile
import webbrowser
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mechsim.cli.command import Result, Stated, Without, command, output_file
from mechsim.cli.exit_codes import notes
from mechsim.cli.load_options import ReleaseOptions, released_model
from mechsim.cli.options import SPEED, ModelOptions
from mechsim.errors import InputError
from mechsim.files import write_content
from mechsim.mechanism.mechanism import require_axis, require_polynomials
from mechsim.units import crank_speed, option

if TYPE_CHECKING:
    from mechsim.pictures.view.pose_grid import View


@command
def view(
    source: Annotated[ModelOptions, Without("loops")],
    release: Annotated[ReleaseOptions, Without("until")],
    stated: Stated,
    output: Annotated[
        str | None,
        output_file("Page to write: .html. Default: a temporary page, opened in the browser.", ".html"),
    ] = None,
    up: str | None = option(
        None, "Axis that points up: x, y, z, -x, ... Default: opposite to gravity, else y.", metavar="AXIS"
    ),
    live: bool = option(
        False, "Solve in the page: sliders of dimensions, points to drag, TOML.", name="--live"
    ),
) -> Result:
    """Write an interactive 3-D page that works offline.

    Examples:
    mechsim view rssr
    mechsim view gripper.xml -o gripper.html
    mechsim view four_bar --live
    mechsim view four_bar --mode 1 --initial crank.q=-95deg
    """
    from mechsim.pictures.view.offline_page import page

    require_axis("--up", up)
    path = None if output is None else Path(output)
    contents = replace(_contents(source, release, stated), up=up)
    if live:
        contents = _live(contents, source, release)
    browser = _browser() if path is None else None
    if path is None:
        path = Path(f"{Path(source.model.split('.py:')[0]).stem}.view.html")
        path = Path(tempfile.mkdtemp(prefix="mechsim-")) / path if browser else path
    write_content(path, page(contents))
    opened = browser is not None and browser.open(path.resolve().as_uri())
    prefix = "no browser on this machine; " if output is None else ""
    text = f"opened {path}" if opened else f"{prefix}wrote {path}"
    data: dict[str, Any] = {"mechanism": contents.mechanism.name, "output": str(path), "opened": opened}
    return Result(data, lambda: typer.echo(text))


def _contents(source: ModelOptions, release: ReleaseOptions, stated: Stated) -> "View":
    """Return the contents of the page: poses of a mechanism, a run from an initial state, or a mode."""
    from mechsim.pictures.render.drawn_model import without_geoms
    from mechsim.report.views import model_view, release_view
    from mechsim.studies.drawn_motion import moved_by_forces

    resting = replace(source, duration=None).load(still=True)
    if release.requested or (moved_by_forces(resting) and not resting.mechanism.drivers):
        release.exclude(stated)
        return release_view(release.release(released_model(source), source), release.mode)
    # a model with drivers of its own, and no request that concerns them, is loaded already
    as_written = resting.source is None and not source.drive and source.duration is None
    solver = resting if as_written and resting.mechanism.drivers else source.load()
    contents = model_view(solver, crank_speed(SPEED))
    notes.extend(without_geoms(solver, contents.bodies))
    return contents


def _live(contents: "View", source: ModelOptions, release: ReleaseOptions) -> "View":
    """Return the contents of a page with its own solver."""
    from mechsim.io.readers import open_model
    from mechsim.report.views import live_view

    if release.requested:
        raise InputError("--live moves a mechanism by its drivers; leave --initial and --mode out")
    designs = source.load_parametric(moving=False)
    solver = source.load(still=True)
    if not solver.mechanism.drivers:
        raise InputError(f"{solver.name}: nothing is driven, and --live moves drivers; leave it out")
    require_polynomials(solver.mechanism, "solved in the page, so leave --live out")
    return live_view(contents, open_model(source.model), solver, designs, crank_speed(SPEED))


def _browser() -> webbrowser.BaseBrowser | None:
    """Return the browser of this machine; None without a screen."""
    no_screen = sys.platform.startswith("linux") and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()
    if no_screen and "BROWSER" not in os.environ:
        return None
    with suppress(webbrowser.Error):
        return webbrowser.get()
    return None
