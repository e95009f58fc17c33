"""Options that several commands share, and how their text becomes values."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from mechsim import files, units
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.derivatives import DesignFamily
from mechsim.analytic.forms import Form
from mechsim.cli import completion
from mechsim.cli.exit_codes import notes
from mechsim.cli.unit_warnings import asked_parameters
from mechsim.errors import InputError, OutputError, require_extra
from mechsim.model.forces import Forces
from mechsim.model.scene import Scene
from mechsim.subjects.mjcf_source import MjcfForm
from mechsim.subjects.readers import load, parametric_model
from mechsim.units import option

# crank speeds in [rad/s]: a turn takes most of a day, and faster than any shaft; MuJoCo's own absolute
# bounds on time and acceleration lie beyond
SLOWEST, FASTEST = 1e-4, 1e9

Model = Annotated[
    str,
    typer.Argument(
        metavar="MODEL",
        help="A name that `mechsim list` gives, FILE.toml, FILE.xml or FILE.py:OBJECT.",
        autocompletion=completion.models,
    ),
]
Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Change a parameter: crank=13mm, pivot=43,-10,-24mm; a bare number is SI.",
        autocompletion=completion.parameters,
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="List all checks, with their tolerances.")]
SPEED = "600rpm"
Speed = Annotated[str, typer.Option(help="Crank speed; a bare number is rad/s.")]
WHERE = typer.Option(
    "-o", "--output", metavar="FILE", help="Where to write.", autocompletion=completion.files
)
File = Annotated[str, WHERE]
Output = Annotated[str | None, WHERE]

ChangePointOption = Annotated[
    str | None,
    typer.Option(
        "--change-point",
        metavar="smooth|branch",
        help="Where two assemblies meet: smooth goes on as a heavy drive does, and so if left out; fold "
        "keeps to its branch.",
    ),
]


def with_policy(form: Form, policy: str | None) -> Form:
    """Return what goes through its change points so; None leaves it as it is."""
    if policy is None:
        return form
    if policy not in ("smooth", "branch"):
        raise InputError(f"--through is {policy!r}; it can be smooth or branch")
    return form.with_change_point("smooth" if policy == "smooth" else "branch")


def pair_of(example: str, *, alone: bool = False) -> Callable[[str], tuple[str, str | None]]:
    """Return what reads NAME=VALUE of an option, as in the example; VALUE may be left out where `alone`."""
    name_of_option = example.partition(" ")[0]

    def read(text: str) -> tuple[str, str | None]:
        name, equals, value = text.partition("=")
        if not name.strip() or (not equals and not alone):
            raise InputError(
                f"{name_of_option} {text!r} has no '='; write {name_of_option} NAME=VALUE, as in {example}"
            )
        return name.strip(), value.strip() if equals else None

    return read


def pairs(example: str, doc: str, metavar: str, *, alone: bool = False) -> Any:
    """Declare an option that may be given many times, each time as NAME=VALUE."""
    return option((), doc, read=pair_of(example, alone=alone), many=True, metavar=metavar)


def driving(doc: str, more: str = "") -> Any:
    """Declare `--drive JOINT=PROGRAM`, told by what stands before and after the kinds of programs."""
    kinds = (
        "600rpm or 20mm/s (steady), 30deg*sin(2*pi*0.6*t) (of t in s; bare numbers are SI), FILE.csv "
        "(columns t, value)."
    )
    return pairs("--drive left=30deg*sin(2*pi*t)", f"{doc}: {kinds}{more}", "JOINT=PROGRAM")


@dataclass(frozen=True, slots=True, kw_only=True)
class LockOptions:
    """What is held."""

    lock: tuple[tuple[str, str | None], ...] = pairs(
        "--lock boom=30deg",
        "Hold a joint, where it starts if no value is given.",
        "JOINT[=VALUE]",
        alone=True,
    )
    fix_base: bool = option(False, "Hold what floats where it starts.", name="--fix-base")


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveOptions(LockOptions):
    """How a mechanism is driven, what is held, and which points count."""

    drive: tuple[tuple[str, str], ...] = driving(
        "How a joint goes over time", " Others than the file's own drivers replace them."
    )
    lock_others: bool = option(
        False,
        "Lock what the drivers leave undetermined where it starts: joints outside loops, and as few in loops "
        "as are enough.",
        name="--lock-others",
    )
    key: str | None = option(None, "Start from this keyframe of an MJCF file.", metavar="NAME")
    track: tuple[str, ...] = option(
        (), "Follow this point, and no others.", read=str, many=True, metavar="NAME[,BODY@X,Y,Z]"
    )
    duration: float | None = option(
        None, "Of the programs; the file's, else as long as a table lasts, else 1 s.", unit="s"
    )


def form_of(
    model: str, sets: list[str] | None, driven: DriveOptions | None = None, *, still: bool = False
) -> Form:
    """Return what a command was given, with the parameters of `--set`, driven as asked; see `load`."""
    changed = changed_by(sets)
    found = load(model, changed, **moved_by(driven), still=still)
    asked_parameters(found, changed)
    if driven is not None and driven.lock_others:
        locked = [name for name in found.mechanism.locked if name not in dict(driven.lock)]
        notes.append(f"{found.name}: joints locked where they start: {', '.join(locked) or 'none'}")
    return _told(found)


def read_family(model: str, sets: list[str] | None, driven: DriveOptions | None = None) -> DesignFamily:
    """Return the family of what a command was given, which as it stands is what `form_of` returns."""
    changed = changed_by(sets)
    found = parametric_model(model, changed, **moved_by(driven))
    asked_parameters(_told(found.make({})), changed)
    return found


def family_of(model: str, sets: list[str] | None, driven: DriveOptions | None = None) -> DesignFamily:
    """Return the family of what a command was given; refuse several drivers without programs."""
    found = read_family(model, sets, driven)
    moving(found.make({}))
    return found


def changed_by(sets: list[str] | None) -> dict[str, str]:
    """Return the parameters that `--set` gives, as text."""
    read = pair_of("--set crank=13mm")
    return {name: value or "" for name, value in map(read, sets or ())}


def moved_by(driven: DriveOptions | None) -> dict[str, Any]:
    """Return how a mechanism is driven, as `load` takes it."""
    if driven is None:
        return {}
    once("--drive", driven.drive)
    once("--lock", driven.lock)
    return {
        "drive": dict(driven.drive),
        "lock": dict(driven.lock),
        "fix_base": driven.fix_base,
        "lock_others": driven.lock_others,
        "key": driven.key,
        "track": driven.track,
        "duration": driven.duration,
    }


def once(what: str, pairs: Sequence[tuple[str, str | None]]) -> None:
    """Refuse an option that names one thing twice."""
    names = [name for name, _ in pairs]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(f"{what} names {twice} twice; give it once")


def _told(form: Form) -> Form:
    """Say on stderr what was left out or changed of an MJCF file."""
    for fact in form.facts if isinstance(form, MjcfForm) else ():
        notes.append(f"{form.name}: {fact}")
    return form


def moving(form: Form) -> Form:
    """Return what moves; refuse several drivers of which nothing says how they go."""
    # what has a closed form has a crank, and its mechanism may be one that cannot be put together
    if form.motion_laws is None and not isinstance(form, ClosedForm) and not form.mechanism.has_crank:
        drivers = form.mechanism.drivers
        far = "10mm" if form.mechanism.unit(drivers[0]) == "m" else "30deg"
        raise InputError(
            f"{form.name}: no program says how {', '.join(drivers)} move{'s' if len(drivers) == 1 else ''}; "
            f"give each a --drive JOINT=PROGRAM, as in --drive '{drivers[0]}={far}*sin(2*pi*t)'"
        )
    return form


def speed_of(text: str) -> float:
    """Return a crank speed in [rad/s], of a size that a run can have."""
    speed = units.parse_speed(text, "the crank speed")
    if not SLOWEST <= abs(speed) <= FASTEST:
        raise InputError(
            f"the crank speed is {text}; give one other than 0, between {SLOWEST:g} and {FASTEST:g} rad/s "
            "either way, as in 600rpm"
        )
    return speed


def scene_of(level: str, cut: str | None = None, forces: Forces | None = None) -> Scene:
    """Return a scene of a level, with loops cut at named joints, and forces where they are known."""
    joints = tuple(cut.split(",")) if cut else None
    return Scene(level=level, cut=joints, forces=forces)  # pyright: ignore[reportArgumentType]


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
    files.require_writable(place)
    return place


def folder_for(path: str) -> Path:
    """Return an output folder, checked before any work is done for it; what is not there, can be made."""
    require_extra("pictures", "jinja2", "matplotlib", "mediapy")
    folder = Path(path)
    if os.path.exists(folder) and not os.path.isdir(folder):
        raise OutputError(f"cannot write into {path!r}: it is a file; name a folder")
    if not os.path.isdir(folder.parent):
        raise OutputError(
            f"cannot make the folder {path!r}: there is no folder {str(folder.parent)!r}; make it first"
        )
    if not os.path.isdir(folder):
        try:
            folder.mkdir()
            # it is made for good by what is written into it
            folder.rmdir()
        except (OSError, ValueError) as error:
            raise OutputError(
                f"cannot make the folder {path!r}: {getattr(error, 'strerror', error)}; choose another place"
            ) from error
    elif not os.access(folder, os.W_OK):
        raise OutputError(f"cannot write into the folder {path!r}; choose another, or change its rights")
    return folder
