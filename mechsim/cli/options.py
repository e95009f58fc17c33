"""Options that several commands share: values, shell completion, and numbers without a unit."""

import sys
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated, Any

import typer

from mechsim.cli.exit_codes import notes, questions
from mechsim.cli.output import plain_number
from mechsim.errors import InputError, require_once
from mechsim.io import catalog, gallery
from mechsim.io.readers import load, load_by_motors, parametric_model
from mechsim.kinematics.designs import DesignFamily
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.numerics.arrays import REVOLUTION
from mechsim.units import IMPLAUSIBLE, option, require_written

# end of a range of angles without a unit, in [rad], above which it is probably in degrees
LARGEST_RANGE = 10.0 * REVOLUTION


def warn_about_angle(name: str, text: str, file_unit: str = "rad") -> None:
    """Warn if an angle without a unit is probably in degrees.

    Raises:
        InputError: if an angle has no unit and the mechanism's file declares another unit than rad.
    """
    require_written(text, "rad", file_unit, name)
    value = plain_number(text)
    if value is not None and abs(value) > REVOLUTION:
        questions.append(
            f"{name} {text} is {value:g} rad, {value / REVOLUTION:.3g} turns; was {text}deg meant?"
        )


def warn_about_angles(name: str, text: str, file_unit: str = "rad") -> None:
    """Warn or raise InputError as `warn_about_angle`, for start:stop:step without units."""
    require_written(text, "rad", file_unit, name)
    values = [plain_number(item) for item in text.split(":")]
    numbers = [value for value in values if value is not None]
    if len(numbers) == len(values) and max(map(abs, numbers)) > LARGEST_RANGE:
        questions.append(f"{name} {text} goes to {max(numbers):g} rad; was {text}deg meant?")


def warn_about_parameters(model: str, texts: Mapping[str, str]) -> None:
    """Warn about parameters of the catalogue without a unit that differ much from their defaults."""
    if model not in catalog.MECHANISMS:
        return
    rows = catalog.parameters(model)
    for name, text in texts.items():
        value, row = plain_number(text), rows.get(name)
        if value is None or row is None:
            continue
        unit, default = row.unit, row.default
        if unit == "rad" and abs(value) > REVOLUTION:
            questions.append(f"--set {name}={text} is {value:g} rad; was {name}={text}deg meant?")
        if unit == "m" and isinstance(default, float) and abs(value) > IMPLAUSIBLE * abs(default) > 0.0:
            questions.append(f"--set {name}={text} is {value:g} m; was {name}={text}mm meant?")


def complete_models(incomplete: str) -> list[str]:
    """Return the names of mechanisms; without one, the shell completes the path of a file."""
    return [name for name in (*catalog.MECHANISMS, *gallery.named()) if name.startswith(incomplete)]


def complete_parameters(ctx: Any, incomplete: str) -> list[str]:
    """Return the parameters of the named mechanism, each with an equals sign."""
    model = ctx.params.get("model") or next((word for word in sys.argv[2:] if not word.startswith("-")), "")
    return [f"{name}=" for name in _parameter_names(str(model)) if name.startswith(incomplete)]


def _parameter_names(model: str) -> list[str]:
    if model in catalog.MECHANISMS:
        return list(catalog.parameters(model))
    path = gallery.named().get(model, Path(model))
    if path.suffix.lower() != ".toml":
        return []
    try:
        read = tomllib.loads(path.read_text(encoding="utf-8")).get("parameters", {})
    except (OSError, ValueError):
        return []
    return list(read) if isinstance(read, dict) else []


Model = Annotated[
    str,
    typer.Argument(
        metavar="MODEL",
        help="A name from `mechsim list`, FILE.toml, .xml (MJCF), .urdf, .sdf, .usd, .json, "
        ".pmks or FILE.py:OBJECT, which is code and is run.",
        autocompletion=complete_models,
    ),
]
Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="NAME=VALUE",
        help="Change a parameter: crank=13mm, pivot=43,-10,-24mm; a bare number is SI.",
        autocompletion=complete_parameters,
    ),
]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="List all checks, with their tolerances.")]
SPEED = "600rpm"
Speed = Annotated[str, typer.Option(help="Crank speed; a bare number is rad/s.")]


ChangePointOption = Annotated[
    str | None,
    typer.Option(
        "--change-point",
        metavar="smooth|branch",
        help="Motion through a change point, where two assemblies meet: smooth keeps the velocities "
        "continuous (default), branch stays in its assembly mode.",
    ),
]


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
    """Declare a repeatable option of the form NAME=VALUE."""
    return option((), doc, read=pair_of(example, name_alone=name_alone), many=True, metavar=metavar)


@dataclass(frozen=True, slots=True, kw_only=True)
class DriveOptions:
    """Drivers, locked joints and tracked points of a mechanism."""

    lock: tuple[tuple[str, str | None], ...] = pairs(
        "--lock boom=30deg",
        "Lock a joint, at its initial value if none is given; `others` stands for all joints that the "
        "drivers leave undetermined, as few in loops as suffice.",
        "JOINT[=VALUE]",
        name_alone=True,
    )
    fix_base: bool = option(False, "Fix floating bases at their initial pose.", name="--fix-base")
    start: tuple[tuple[str, str], ...] = pairs(
        "--start knee=-30deg",
        "Start in the assembly nearest to this value of a joint.",
        "JOINT=VALUE",
    )
    key: str | None = option(None, "Start from this keyframe of an MJCF file.", metavar="NAME")
    loops: str | None = option(None, "Loop closures of a URDF file, in YAML.", metavar="FILE")
    drive: tuple[tuple[str, str], ...] = pairs(
        "--drive left=30deg*sin(2*pi*t)",
        "Motion law of a joint, a point (P.x) or a link (plate.x, plate.rz): a speed (600rpm, 20mm/s), an "
        "expression of t in s (30deg*sin(2*pi*0.6*t)), or FILE.csv with columns t, value. It replaces the "
        "drivers of the file if it names another coordinate.",
        "COORDINATE=LAW",
    )
    track: tuple[str, ...] = option(
        (), "Track this point instead of those of the file.", read=str, many=True, metavar="NAME[,BODY@X,Y,Z]"
    )
    duration: float | None = option(
        None, "Duration of the motion laws. Default: that of the file or of its table, else 1 s.", unit="s"
    )

    @property
    def locks_others(self) -> bool:
        """Whether joints that the drivers leave undetermined are locked."""
        return ("others", None) in self.lock

    def as_arguments(self) -> dict[str, Any]:
        """Return the options as arguments of `load`."""
        options = {field.name: getattr(self, field.name) for field in fields(DriveOptions)}
        options |= {name: dict(getattr(self, name)) for name in ("drive", "lock", "start")}
        if self.locks_others:
            del options["lock"]["others"]
        return options | {"lock_others": self.locks_others}

    def applied_to(self, model: str, sets: list[str] | None = None) -> "ModelOptions":
        """Return these options of a model with changed parameters."""
        options = {field.name: getattr(self, field.name) for field in fields(DriveOptions)}
        return ModelOptions(model=model, sets=sets, **options)


@dataclass(frozen=True, slots=True, kw_only=True)
class ControlOptions:
    """Controls of the actuators of a user's MJCF scene."""

    ctrl: tuple[tuple[str, str], ...] = pairs(
        "--ctrl servo=0.3*sin(2*pi*t)",
        "Control of an actuator of an MJCF file, in its own unit: a number, an expression of t in s "
        "(255*(0.5-0.5*cos(2*pi*t))), or FILE.csv. The file is stepped with its own settings, except those "
        "given here.",
        "ACTUATOR=LAW",
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelOptions(DriveOptions):
    """A mechanism, its changed parameters, and its motion."""

    model: Model
    sets: Sets = None

    @property
    def parameters(self) -> dict[str, str]:
        """The changed parameters, as text."""
        changed = [(name, value or "") for name, value in map(pair_of("--set crank=13mm"), self.sets or ())]
        require_once("--set", [name for name, _ in changed])
        return dict(changed)

    def load_arguments(self) -> dict[str, Any]:
        """Return the options and the changed parameters as arguments of `load`."""
        return self.as_arguments() | {"set": self.parameters}

    def load(self, *, still: bool = False, by_motors: bool = False) -> KinematicSolver:
        """Return the mechanism; see `mechsim.load` and `load_by_motors`."""
        warn_about_parameters(self.model, self.parameters)
        opened = load_by_motors if by_motors else load
        return _with_notes(opened(self.model, **self.load_arguments(), still=still))

    def load_with_policy(self, policy: str | None) -> KinematicSolver:
        """Return the mechanism with a change-point policy; None leaves it unchanged."""
        solver = self.load()
        if policy is None:
            return solver
        if policy not in ("smooth", "branch"):
            raise InputError(f"--change-point is {policy!r}; it can be smooth or branch")
        if not solver.change_points():
            raise InputError(f"{solver.name} has no change points; leave out --change-point")
        return solver.with_change_point("smooth" if policy == "smooth" else "branch")

    def load_moving(self, *, by_motors: bool = False) -> KinematicSolver:
        """Return a mechanism whose motion is determined by a crank or by motion laws."""
        return require_motion(self.load(by_motors=by_motors))

    def load_parametric(self, *, moving: bool = True) -> DesignFamily:
        """Return the parametric model of a mechanism; with `moving` its motion must be determined."""
        warn_about_parameters(self.model, self.parameters)
        parametric = parametric_model(self.model, **self.load_arguments())
        solver = _with_notes(parametric.make({}))
        if moving:
            require_motion(solver)
        return parametric

    def require_other_drivers(self) -> None:
        """Raise InputError if --drive names the model's drivers, where only their names have an effect."""
        if self.drive:
            solver = load(self.model, **replace(self, drive=()).load_arguments(), still=True)
            if {*solver.mechanism.drivers} == {name for name, _ in self.drive}:
                raise InputError(
                    f"--drive has no effect, since {solver.name} is driven at "
                    f"{', '.join(solver.mechanism.drivers)} and no motion law is written; leave it out"
                )


def joint_ranges(option_name: str, text: str) -> dict[str, tuple[str, str] | None]:
    """Return joints and their ranges as text, from J=-20deg:20deg,K; None for the joint limits."""
    ranges: dict[str, tuple[str, str] | None] = {}
    named = [item.partition("=") for item in text.split(",")]
    require_once(option_name, [name for name, _, _ in named])
    for name, equals, ends in named:
        low, _, high = ends.partition(":")
        if equals and not (low and high):
            raise InputError(f"{option_name} has {name}={ends}; write the range as {name}=-20deg:20deg")
        ranges[name] = (low, high) if equals else None
    return ranges


def _with_notes(solver: KinematicSolver) -> KinematicSolver:
    """Return a mechanism, and note what was changed to read and assemble it."""
    for fact in solver.facts:
        notes.append(f"{solver.name}: {fact}")
    return solver


def require_motion(solver: KinematicSolver) -> KinematicSolver:
    """Return a mechanism; raise InputError if several drivers have no motion law."""
    # not its mechanism, which may be impossible to assemble
    solver.motion_laws.require_drivers(solver.described)
    return solver
