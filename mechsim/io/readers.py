"""Models from names, files and objects: `load`, and parametric models of designs."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import wraps
from inspect import signature
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeAlias, TypeVar

from mechsim import units
from mechsim.errors import InputError, require_known
from mechsim.io import catalog, gallery
from mechsim.io.model_source import (
    READERS,
    ModelSource,
    Prescription,
    file_reader,
    object_reader,
)
from mechsim.io.prescription import prescribed_solver, written_guess
from mechsim.io.python_object import GivenObject
from mechsim.kinematics.designs import DesignFamily, own_designs
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_laws import State

if TYPE_CHECKING:
    from mechsim.simulation.mjcf_reader.parsed_file import MujocoInput

    Model: TypeAlias = PathLike[str] | KinematicSolver | Mechanism | MujocoInput | ModelSource


def open_model(model: Model) -> ModelSource:
    """Return the source of a model; a file is read here and nowhere else.

    Raises:
        InputError: for an unknown name, a file that cannot be read, or an object of another type.
    """
    if isinstance(model, ModelSource):
        return model
    if not isinstance(model, str | PathLike):
        reader = object_reader(model)
        if reader is None:
            kind = type(model).__name__
            raise InputError(
                f"a model is of type {kind}; give a name or a file, such as 'rssr' or 'linkage.toml'"
            )
        return reader.open(model)
    name = fspath(model)
    if reader := file_reader(name):
        return reader.open(name)
    if name in catalog.MECHANISMS:
        return catalog.mechanism(name)
    files = gallery.named()
    if name not in files:
        raise _unknown_model(name, [*catalog.MECHANISMS, *files])
    return open_model(files[name])


# what to do with files of other programs
CONVERSIONS = {
    ".xacro": "expand it into URDF (xacro FILE.xacro -o FILE.urdf) and name that file",
}


def _unknown_model(name: str, names: list[str]) -> InputError:
    """Return the error for a model that is neither a name nor a file with a known suffix."""
    suffixes = [suffix for reader in READERS for suffix in reader.suffixes]
    path = Path(name)
    if file := next((f"{name}{suffix}" for suffix in suffixes if os.path.isfile(f"{name}{suffix}")), None):
        return InputError(f"there is no mechanism {name!r}; did you mean the file {file!r}?")
    if os.path.exists(name) or path.suffix.lower() in CONVERSIONS:
        kind = "a folder" if os.path.isdir(name) else f"a file with suffix {path.suffix!r}"
        remedy = CONVERSIONS.get(path.suffix.lower(), f"name a file that ends in {', '.join(suffixes)}")
        return InputError(f"{name!r} is {kind}, which mechsim does not read; {remedy}")
    return InputError(f"there is no mechanism {name!r}{catalog.nearest(name, names)}")


P = ParamSpec("P")
R = TypeVar("R")


def _naming_options(call: Callable[P, R]) -> Callable[P, R]:
    """Return a function of a model that names its options where it gets another."""
    options = [*signature(call).parameters]

    @wraps(call)
    def checked(*args: P.args, **stated: P.kwargs) -> R:
        require_known("a model has no option", stated, options)
        return call(*args, **stated)

    return checked


@_naming_options
def load(
    model: Model,
    set: Mapping[str, str | float] | None = None,
    *,
    drive: Mapping[str, str | State] | None = None,
    lock: Mapping[str, str | float | None] | Iterable[str] = (),
    start: Mapping[str, str | float] | None = None,
    fix_base: bool = False,
    lock_others: bool = False,
    key: str | None = None,
    track: Iterable[str] = (),
    duration: str | float | None = None,
    still: bool = False,
    loops: str | None = None,
) -> KinematicSolver:
    """Return the solver of a model.

    Args:
        model: a name of the catalogue or the gallery; FILE.toml; FILE.xml in MJCF; FILE.urdf; FILE.sdf;
            FILE.usd; a planar linkage in FILE.json or FILE.pmks; or FILE.py:OBJECT. The object is a
            Mechanism, an object of the catalogue, or a function that returns one; arguments with numbers as
            defaults are parameters (the Python file is run). Also such an object itself, a `mujoco.MjSpec`,
            or the `mujoco.MjModel` that MuJoCo loaded last.
        set: parameter -> its value as text, as in `--set`, or a number in SI;
            docs/reference/toml.md states the rule for numbers without a unit.
        drive: coordinate -> its motion law: text as in `--drive`, or a function of times (n,) in [s]
            that returns value, rate and acceleration, (n,) each in SI.
        lock: joint or coordinate -> its constant value, as text or in SI; None, or a name alone, is the
            initial value.
        start: joint -> value as text or in SI; the initial assembly is the nearest one.
        fix_base: whether floating bases are fixed at their initial pose.
        lock_others: whether joint coordinates that the drivers do not determine are locked at their initial
            values: all outside loops, and in loops as many as there are undetermined degrees of freedom.
        key: name of the keyframe to start from, for MuJoCo models.
        track: points to record, as `NAME` or `NAME,LINK@x,y,z`; all by default.
        duration: duration of the motion laws, as text or in [s].
        still: whether drivers may be missing: a MuJoCo model may have none, and those without a motion law
            are free in a run from an initial state.
        loops: path of a sidecar file with the loop closures of a URDF file.

    Raises:
        InputError: for an invalid model or option; names the file, the line, the value and the remedy.
    """
    options = {"drive": drive, "lock": lock, "start": start, "fix_base": fix_base, "key": key, "track": track}
    more = {"lock_others": lock_others, "duration": duration, "still": still, "loops": loops}
    source, changed, prescription = open_model(model), dict(set or {}), _prescription(options | more)
    solver = prescribed_solver(source, changed, prescription, assembled=True)
    if solver.parameters and solver.closed_form is None and not isinstance(source, GivenObject):
        object.__setattr__(solver, "loaded_from", (source, changed, prescription))
    return solver


def load_by_motors(
    model: Model, set: Mapping[str, str | float] | None = None, **options: Any
) -> KinematicSolver:
    """Return the solver of a model whose actual drivers follow the motion of driven points or links.

    Drive forces are then those of its motors. A model whose drivers are joints is returned as by `load`.

    Args:
        model, set, options: as in `load`.

    Raises:
        InputError: as `load`, and for a model without drivers of its own.
    """
    source = open_model(model)
    solver = load(source, set, **options)
    if solver.motion_laws.crank:
        return solver
    from mechsim.io.pose_drivers import is_pose_driven, motor_laws

    if not is_pose_driven(solver.mechanism):
        return solver
    undriven: dict[str, Any] = options | {"drive": None, "duration": None, "still": True}
    laws = motor_laws(solver, load(source, set, **undriven).mechanism)
    driven: dict[str, Any] = options | {"drive": laws, "duration": solver.motion_laws.duration}
    return load(source, set, **driven)


def _prescription(options: Mapping[str, Any]) -> Prescription:
    """Return the prescription of options of `load`, of which None stands for the default."""
    require_known("a model has no option", options, Prescription.__dataclass_fields__)
    stated = {name: value for name, value in options.items() if value is not None}
    if not isinstance(stated.get("lock", {}), Mapping):
        stated["lock"] = dict.fromkeys(stated["lock"])
    stated["track"] = tuple(stated.get("track", ()))
    if "duration" in stated:
        stated["duration"] = units.si(stated["duration"], "s", "the duration")
    if "loops" in stated:
        stated["loops"] = fspath(stated["loops"])
    return Prescription(**stated)


def parametric_model(
    model: Model, set: Mapping[str, str | float] | None = None, **options: Any
) -> DesignFamily:
    """Return a parametric model: its dimensions in SI, and the function that makes a design.

    The dimensions of a catalogue mechanism, a TOML file and a Python function are their parameters. A vector
    counts by component, such as pivot.x; arguments of a Python function have no unit. The dimensions of any
    other model are its joint positions, such as JOINT.at.x.

    Args:
        model: as in `load`.
        set: parameter -> its value, as in `load`.
        options: other options of `load`.

    Raises:
        InputError: as `load`.
    """
    changed, prescription = dict(set or {}), _prescription(options)
    source = open_model(model)
    if isinstance(source, GivenObject) and not set and not options:
        loaded = getattr(source.model, "loaded_from", None)
        source, changed, prescription = loaded or (source, changed, prescription)
    # an object keeps its own guess
    own = isinstance(source, GivenObject)
    guess = {} if own else written_guess(source)
    solver = prescribed_solver(source, changed, prescription, assembled=not own, guess=guess)
    parameters = source.parameters(changed)
    dimensions = parameters.dimensions
    if not dimensions:
        return replace(own_designs(solver), intended_use=parameters.intended_use)

    def design(values: Mapping[str, float], *, assembled: bool) -> KinematicSolver:
        if not values:
            return solver
        texts = {name: as_text(value, dimensions[name].unit) for name, value in values.items()}
        return prescribed_solver(source, changed | texts, prescription, assembled=assembled, guess=guess)

    derived = {name: used for name, used in parameters.derived.items() if used and name not in changed}
    return DesignFamily(
        solver.name,
        dimensions,
        lambda values: design(values, assembled=False).mechanism,
        lambda values: design(values, assembled=True),
        None if solver.forces is None else lambda values: design(values, assembled=False).forces,
        tuple(name for name in dimensions if name not in derived),
        derived,
        parameters.intended_use,
    )


def as_text(value: float, unit: str) -> str:
    """Return a dimension in SI as text that a file with any units reads to the last bit."""
    return f"{float(value)!r} {unit}" if unit in ("m", "rad") else repr(float(value))
