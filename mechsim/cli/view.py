"""Command `mechsim view`: an interactive 3-D page of a mechanism."""

import os
import sys
import tempfile
import webbrowser
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from mechsim.cli.command import Result, command
from mechsim.cli.options import SPEED, ModelOptions, Output, Speed, speed_of, writable
from mechsim.cli.schema import Written
from mechsim.files import atomic_path
from mechsim.model.mechanism import require_axis
from mechsim.subjects.mjcf_source import MjcfForm


class ViewJson(Written):
    """A written page, and whether a browser showed it."""

    opened: bool


@command
def view(
    source: ModelOptions,
    output: Output = None,
    speed: Speed = SPEED,
    up: Annotated[
        str | None,
        typer.Option(
            metavar="AXIS", help="Axis that points up: x, y, z, -x, ... Default: against gravity, else y."
        ),
    ] = None,
) -> Result[ViewJson]:
    """Write an interactive page that works offline; without -o the browser opens it.

    Examples:
    mechsim view rssr
    mechsim view gripper.xml -o gripper.html
    """
    from mechsim.pictures.view import page
    from mechsim.report.views import mechanism_view

    require_axis("--up", up)
    path = None if output is None else writable(output, ".html")
    solver = source.load()
    mjcf = solver.source if isinstance(solver, MjcfForm) else None
    contents = replace(mechanism_view(solver, speed_of(speed), mjcf.limits if mjcf else None), up=up)
    browser = None
    if path is None:
        browser = _browser()
        name = f"{Path(source.model.split('.py:')[0]).stem}.view.html"
        path = Path(tempfile.mkdtemp(prefix="mechsim-")) / name if browser else Path(name)
    with atomic_path(path) as unfinished:
        unfinished.write_text(page(contents), encoding="utf-8")
    opened = browser is not None and browser.open(path.resolve().as_uri())
    prefix = "no browser on this machine; " if output is None else ""
    text = f"opened {path}" if opened else f"{prefix}wrote {path}"
    data: ViewJson = {"mechanism": solver.name, "output": str(path), "opened": opened}
    return Result(data, lambda: typer.echo(text))


def _browser() -> webbrowser.BaseBrowser | None:
    """Return the browser of this machine; None where there is no screen for it."""
    no_screen = sys.platform.startswith("linux") and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()
    if no_screen and "BROWSER" not in os.environ:
        return None
    with suppress(webbrowser.Error):
        return webbrowser.get()
    return None
