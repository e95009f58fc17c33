"""Options that several commands share, and how their text becomes values."""

import os
from pathlib import Path
from typing import Annotated

import typer

from mechsim import files, units
from mechsim.analytic.forms import Form
from mechsim.errors import InputError, OutputError
from mechsim.model.scene import Scene
from mechsim.subjects.subject import load

# crank speeds in [rad/s]: a turn takes most of a day, and faster than any shaft; MuJoCo's own absolute
# bounds on time and acceleration lie beyond
SLOWEST, FASTEST = 1e-4, 1e9

Model = Annotated[
    str,
    typer.Argument(metavar="MODEL", help="A name that `mechsim list` gives, FILE.toml or FILE.py:OBJECT."),
]
Sets = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="NAME=VALUE", help="Change a parameter: crank=13mm, pivot=43,-10,-24mm."),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
Speed = Annotated[str, typer.Option(help="Crank speed; a bare number is rad/s.")]
File = Annotated[str, typer.Option("-o", "--output", metavar="FILE", help="Where to write.")]
Output = Annotated[str | None, typer.Option("-o", "--output", metavar="FILE", help="Where to write.")]

ThroughChange = Annotated[
    str,
    typer.Option(
        "--through",
        metavar="smooth|fold",
        help="Where two assemblies meet: smooth goes on as a heavy drive does, fold keeps to its branch.",
    ),
]


def passed(form: Form, through: str) -> Form:
    """Return what goes through its change points so."""
    if through not in ("smooth", "fold"):
        raise InputError(f"--through is {through!r}; it can be smooth or fold")
    return form.passing("smooth" if through == "smooth" else "fold")


def form_of(model: str, sets: list[str] | None) -> Form:
    """Return what a command was given, with the parameters of `--set`."""
    changed: dict[str, str] = {}
    for text in sets or ():
        parameter, equals, value = text.partition("=")
        if not equals:
            raise InputError(f"--set {text!r} has no '='; write --set name=value, as in --set crank=13mm")
        changed[parameter.strip()] = value.strip()
    return load(model, changed)


def speed_of(text: str) -> float:
    """Return a crank speed in [rad/s], of a size that a run can have."""
    speed = units.parse_speed(text, "the crank speed")
    if not SLOWEST <= abs(speed) <= FASTEST:
        raise InputError(
            f"the crank speed is {text}; give one other than 0, between {SLOWEST:g} and {FASTEST:g} rad/s "
            "either way, as in 600rpm"
        )
    return speed


def scene_of(level: str, cut: str | None = None) -> Scene:
    """Return a scene of a level, with loops cut at named joints."""
    return Scene(level=level, cut=tuple(cut.split(",")) if cut else None)  # pyright: ignore[reportArgumentType]


def writable(path: str, *extensions: str) -> Path:
    """Return an output path, checked before any work is done for it."""
    place = Path(path)
    if os.path.isdir(place):
        raise OutputError(f"cannot write {path!r}: it is a folder; give a file name")
    if extensions and place.suffix.lower() not in extensions:
        known = ", ".join(filter(None, extensions))
        raise InputError(f"{path!r} ends in {place.suffix or 'nothing'}; known are {known}")
    folder = place.parent
    if not os.path.isdir(folder) or not os.access(folder, os.W_OK):
        raise OutputError(
            f"cannot write {path!r}: {str(folder)!r} is no folder that can be written; make it first"
        )
    files.place_of(place)
    return place


def folder_for(path: str) -> Path:
    """Return an output folder, made if it was not there, checked before any work is done for it."""
    folder = Path(path)
    if os.path.exists(folder) and not os.path.isdir(folder):
        raise OutputError(f"cannot write into {path!r}: it is a file; name a folder")
    if not os.path.isdir(folder.parent):
        raise OutputError(
            f"cannot make the folder {path!r}: there is no folder {str(folder.parent)!r}; make it first"
        )
    try:
        folder.mkdir(exist_ok=True)
    except (OSError, ValueError) as error:
        raise OutputError(
            f"cannot make the folder {path!r}: {getattr(error, 'strerror', error)}; choose another place"
        ) from error
    if not os.access(folder, os.W_OK):
        raise OutputError(f"cannot write into the folder {path!r}; choose another, or change its rights")
    return folder
