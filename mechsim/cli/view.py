"""Command `mechsim view`: a page in which a mechanism is turned by hand."""

import os
import sys
import tempfile
import webbrowser
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from mechsim.cli.declared_options import spread
from mechsim.cli.options import (
    SPEED,
    DriveOptions,
    Json,
    Model,
    Output,
    Sets,
    Speed,
    form_of,
    speed_of,
    writable,
)
from mechsim.cli.output import print_json
from mechsim.files import atomic_path
from mechsim.model.mechanism import require_axis
from mechsim.subjects.mjcf_source import MjcfForm


@spread
def view(
    model: Model,
    driven: DriveOptions,
    output: Output = None,
    speed: Speed = SPEED,
    up: Annotated[
        str | None,
        typer.Option(
            metavar="AXIS",
            help="Axis that points up: x, y, z, -x, -y, -z; against gravity, else y, if left out.",
        ),
    ] = None,
    sets: Sets = None,
    as_json: Json = False,
) -> None:
    """Make a page to turn a mechanism by hand, offline; without -o the browser opens it."""
    from mechsim.pictures.view import page
    from mechsim.report.views import mechanism_view

    require_axis("--up", up)
    place = None if output is None else writable(output, ".html")
    form = form_of(model, sets, driven)
    read = form.source if isinstance(form, MjcfForm) else None
    shown = mechanism_view(form, speed_of(speed), read.limits if read else None)
    text = page(replace(shown, up=up))
    browser = None if place is not None else _browser()
    if place is None:
        stem = Path(model.split(".py:")[0]).stem
        name = f"{stem}.view.html"
        place = Path(tempfile.mkdtemp(prefix="mechsim-")) / name if browser else Path(name)
    with atomic_path(place) as beside:
        beside.write_text(text, encoding="utf-8")
    opened = browser is not None and browser.open(place.resolve().as_uri())
    if as_json:
        print_json({"mechanism": form.name, "output": str(place), "opened": opened})
        return
    if opened:
        typer.echo(f"opened {place}")
        return
    said = "" if output is not None else "no browser to open it in here; "
    typer.echo(f"{said}wrote {place}")


def _browser() -> webbrowser.BaseBrowser | None:
    """Return the browser of this machine; None where there is no screen to show it on."""
    screenless = sys.platform.startswith("linux") and not {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()
    if screenless and "BROWSER" not in os.environ:
        return None
    with suppress(webbrowser.Error):
        return webbrowser.get()
    return None
