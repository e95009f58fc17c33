"""Options that several commands share, and how their text becomes values."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from mechsim import files
from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.derivatives.dimensions import DesignFamily
from mechsim.analytic.solvers import KinematicSolver
from mechsim.cli import completion
from mechsim.cli.exit_codes import notes
from mechsim.cli.unit_warnings import warn_about_parameters
from mechsim.errors import InputError, OutputError, require_extra
from mechsim.model.forces import Forces
from mechsim.model.scene import Scene
from mechsim.subjects.mjcf_source import MjcfForm
from mechsim.subjects.readers import load, load_by_motors, parametric_model
from mechsim.units import option

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
        help="Policy where two assemblies meet: smooth continues as a heavy drive does (default), branch "
        "stays on the branch.",
    ),
]


def with_policy(solver: KinematicSolver, policy: str | None) -> KinematicSolver:
    """Return a mechanism with a change-point policy; None leaves it unchanged."""
    if policy is None:
        return solver
    if policy not in ("smooth", "branch"):
        raise InputError(f"--change-point is {policy!r}; it can be smooth or branch")
    return solver.with_change_point("smooth" if policy == "smooth" else "branch")


def pair_of(example: str, *, name_alone: bool = False) -> Callable[[str], tuple[str, str | None]]:
    """Return a reader of NAME=VALUE of the option in the example; VALUE is optional with `name_alone`."""
    option_name = example.partition(" ")[0]

    def read(text: str) -> tuple[str, str | None]:
        name, equals, value = text.partition("=")
        if not name.strip() or (not equals and not name_alone):
            raise InputError(
                f"{option_name} {text!r} has no '='; write {option_name} NAME=VALUE, as in {example}"
            )
        return name.strip(), value.strip() if equals else None

    return read


def pairs(example: str, doc: str, metavar: str, *, name_alone: bool = False) -> Any:
    """Declare an option that is repeated, each time as NAME=VALUE."""
    return option((), doc, read=pair_of(example, name_alone=name_alone), many=True, metavar=metavar)


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveOptions:
    """How a mechanism is driven, what is locked, and which points are tracked."""

    lock: tuple[tuple[str, str | None], ...] = pairs(
        "--lock boom=30deg",
        "Lock a joint, at its initial value if none is given.",
        "JOINT[=VALUE]",
        name_alone=True,
    )
    lock_others: bool = option(
        False,
        "Lock what the drivers leave undetermined at its initial value: joints outside loops, and as few in "
        "loops as suffice.",
        name="--lock-others",
    )
    fix_base: bool = option(False, "Fix floating bases at their initial pose.", name="--fix-base")
    drive: tuple[tuple[str, str], ...] = pairs(
        "--drive left=30deg*sin(2*pi*t)",
        "Motion law of a joint, a point (P.x) or a link (plate.x, plate.rz): 600rpm or 20mm/s (constant), "
        "30deg*sin(2*pi*0.6*t) (t in s; bare numbers are SI), FILE.csv (columns t, value). Other drivers "
        "than the file's own replace them.",
        "COORDINATE=LAW",
    )
    key: str | None = option(None, "Start from this keyframe of an MJCF file.", metavar="NAME")
    track: tuple[str, ...] = option(
        (), "Track this point and no others.", read=str, many=True, metavar="NAME[,BODY@X,Y,Z]"
    )
    duration: float | None = option(
        None, "Of the motion laws. Default: the file's, else that of a table, else 1 s.", unit="s"
    )

    def as_arguments(self) -> dict[str, Any]:
        """Return the options as arguments of `load`."""
        require_distinct("--drive", self.drive)
        require_distinct("--lock", self.lock)
        return {
            "drive": dict(self.drive),
            "lock": dict(self.lock),
            "fix_base": self.fix_base,
            "lock_others": self.lock_others,
            "key": self.key,
            "track": self.track,
            "duration": self.duration,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelOptions(DriveOptions):
    """A mechanism, its changed parameters, and how it moves."""

    model: Model
    sets: Sets = None

    def load(self, *, still: bool = False, by_motors: bool = False) -> KinematicSolver:
        """Return the mechanism; see `mechsim.load` and `load_by_motors`."""
        return load_model(self.model, self.sets, self, still=still, by_motors=by_motors)

    def load_moving(self, *, by_motors: bool = False) -> KinematicSolver:
        """Return a mechanism whose motion is determined by a crank or by motion laws."""
        return require_motion(self.load(by_motors=by_motors))

    def load_parametric(self) -> DesignFamily:
        """Return the parametric model of a mechanism whose motion is determined."""
        return load_parametric(self.model, self.sets, self)


def load_model(
    model: str,
    sets: list[str] | None = None,
    driven: DriveOptions | None = None,
    *,
    still: bool = False,
    by_motors: bool = False,
) -> KinematicSolver:
    """Return a mechanism with changed parameters and drivers; see `mechsim.load`."""
    driven, parameters = driven or DriveOptions(), changed_parameters(sets)
    opened = load_by_motors if by_motors else load
    solver = opened(model, parameters, **driven.as_arguments(), still=still)
    warn_about_parameters(solver, parameters)
    if driven.lock_others:
        locked = [name for name in solver.mechanism.locked if name not in dict(driven.lock)]
        notes.append(f"{solver.name}: joints locked at their initial values: {', '.join(locked) or 'none'}")
    return _with_notes(solver)


def load_parametric(
    model: str, sets: list[str] | None, driven: DriveOptions, *, moving: bool = True
) -> DesignFamily:
    """Return a parametric model; with `moving` its motion must be determined."""
    parameters = changed_parameters(sets)
    parametric = parametric_model(model, parameters, **driven.as_arguments())
    solver = _with_notes(parametric.make({}))
    warn_about_parameters(solver, parameters)
    if moving:
        require_motion(solver)
    return parametric


def changed_parameters(sets: list[str] | None) -> dict[str, str]:
    """Return the parameters that `--set` gives, as text."""
    read = pair_of("--set crank=13mm")
    return {name: value or "" for name, value in map(read, sets or ())}


def joint_ranges(option_name: str, text: str) -> dict[str, tuple[str, str] | None]:
    """Return joints and their ranges as text, from J=-20deg:20deg,K; None for the joint limits."""
    ranges: dict[str, tuple[str, str] | None] = {}
    for item in text.split(","):
        name, equals, ends = item.partition("=")
        low, _, high = ends.partition(":")
        if equals and not (low and high):
            raise InputError(f"{option_name} is given {item!r}; write the range as {name}=-20deg:20deg")
        ranges[name] = (low, high) if equals else None
    return ranges


def require_distinct(option_name: str, pairs: Sequence[tuple[str, str | None]]) -> None:
    """Raise InputError where an option names something twice."""
    names = [name for name, _ in pairs]
    if twice := next((name for name in names if names.count(name) > 1), None):
        raise InputError(f"{option_name} names {twice} twice; give it once")


def _with_notes(solver: KinematicSolver) -> KinematicSolver:
    """Return a mechanism, and note what was changed in its MJCF file."""
    for fact in solver.facts if isinstance(solver, MjcfForm) else ():
        notes.append(f"{solver.name}: {fact}")
    return solver


def require_motion(solver: KinematicSolver) -> KinematicSolver:
    """Return a mechanism; raise InputError if several drivers have no motion law."""
    # a closed form has a crank, and its mechanism may be one that cannot be assembled
    if not isinstance(solver, ClosedForm):
        solver.motion_laws.require_drivers(solver.mechanism)
    return solver


def scene_of(level: str, cut: str | None = None, forces: Forces | None = None) -> Scene:
    """Return a scene of a level, with loops cut at named joints, and forces where they are known."""
    joints = tuple(cut.split(",")) if cut else None
    return Scene(level=level, cut=joints, forces=forces)  # pyright: ignore[reportArgumentType]


def writable(path: str, *extensions: str) -> Path:
    """Return an output path, checked before any work is done for it."""
    target = Path(path)
    if os.path.isdir(target):
        raise OutputError(f"cannot write {path!r}: it is a folder; give a file name")
    if extensions and target.suffix.lower() not in extensions:
        extensions_text = ", ".join(filter(None, extensions))
        raise InputError(f"{path!r} ends in {target.suffix or 'nothing'}; known are {extensions_text}")
    folder = target.parent
    if not os.path.isdir(folder) or not os.access(folder, os.W_OK):
        raise OutputError(f"cannot write {path!r}: {str(folder)!r} is not a writable folder; make it first")
    files.require_writable(target)
    return target


def folder_for(path: str) -> Path:
    """Return an output folder, checked before any work is done for it; a missing folder is created later."""
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
            # what is written into it creates it again
            folder.rmdir()
        except (OSError, ValueError) as error:
            raise OutputError(
                f"cannot make the folder {path!r}: {getattr(error, 'strerror', error)}; choose another path"
            ) from error
    elif not os.access(folder, os.W_OK):
        raise OutputError(f"cannot write into the folder {path!r}; choose another, or change its rights")
    return folder
