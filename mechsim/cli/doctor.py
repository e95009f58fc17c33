"""Command about this machine: doctor."""

import platform
from importlib.util import find_spec
from typing import Any

import typer

from mechsim.cli.options import Json
from mechsim.cli.output import print_json, print_table
from mechsim.errors import MissingToolError


def doctor(as_json: Json = False) -> None:
    """Say what this machine has: OpenGL back ends, ffmpeg, versions, and what mends what is missing."""
    found = examine()
    if as_json:
        print_json(found)
        return
    print_table("Versions", ("what", "version"), found["versions"].items())
    rows = [
        (
            row["name"],
            row["driver"] if row["works"] else "does not work",
            "software" if row["software"] else "",
        )
        for row in found["opengl"]
    ]
    print_table("OpenGL without a screen", ("back end", "driver", ""), rows)
    typer.echo(f"ffmpeg: {found['ffmpeg'] or 'none'}")
    typer.echo(f"to mend what is missing: {found['remedy']}" if found["remedy"] else "nothing is missing")


def examine() -> dict[str, Any]:
    """Return what this machine has, as plain data."""
    from mechsim.pictures.render import describe_backend, find_ffmpeg
    from mechsim.report.page import versions

    found = versions() | {"machine": platform.platform()}
    backends = describe_backend()
    remedies: list[str] = []
    if any(find_spec(library) is None for library in ("matplotlib", "mediapy", "jinja2", "PIL")):
        remedies.append("pip install 'mechsim[pictures]'")
    if not any(row["works"] for row in backends):
        packages = " ".join(str(row["package"]) for row in backends if row["package"])
        remedies.append(f"apt-get install {packages}")
    try:
        ffmpeg = str(find_ffmpeg())
    except MissingToolError:
        ffmpeg = None
        remedies.append("pip install imageio-ffmpeg")
    return {"versions": found, "opengl": backends, "ffmpeg": ffmpeg, "remedy": " && ".join(remedies)}
