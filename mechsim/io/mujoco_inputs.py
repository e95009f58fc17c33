"""Models that MuJoCo compiles, in the assembly in which every command starts them."""

from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim.errors import AssemblyError, InputError, MechsimError
from mechsim.io.model_source import file_reader
from mechsim.kinematics.loops.rounded_geometry import MAX_ANGLE, Corrected, corrected
from mechsim.kinematics.loops.start import closed_start, start_poses, with_requested_start
from mechsim.mechanism.finding import HARMLESS, Finding
from mechsim.mechanism.links import Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array

if TYPE_CHECKING:
    from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel
    from mechsim.simulation.mjcf_reader.parsed_file import MujocoInput


def mujoco_input(model: Any, loops: str | PathLike[str] | None = None) -> "MujocoInput | None":
    """Return the path or object of a model that MuJoCo compiles; None for any other model.

    Rounded angles that lock its loops are exact in it.

    Args:
        model: as in `load`; for a solver that was read from MJCF, the specification that it runs.
        loops: path of a sidecar file with the loop closures of a URDF file.

    Raises:
        InputError: for `loops` with another model.
    """
    source = _source(model, loops)
    if source is None:
        return None
    from mechsim.simulation.mjcf_reader.reading import read_model

    with suppress(MechsimError):
        return with_exact_angles(source, corrected(read_model(source, lint=True).mechanism))
    return source


def linted(model: Any, loops: str | PathLike[str] | None = None) -> "MjcfModel | None":
    """Return a model that MuJoCo compiles as the linter reads it; None for any other model.

    Arguments and errors are those of `mujoco_input` and `read_model`.
    """
    source, exact = _source(model, loops), None
    if source is None:
        return None
    from mechsim.simulation.mjcf_reader.reading import read_model

    read = read_model(source, lint=True)
    with suppress(MechsimError):
        exact = corrected(read.mechanism)
    if exact is not None and exact.finding is not None:
        read, exact = read_model(with_exact_angles(source, exact), lint=True), None
    if exact is None or not exact.consistent:
        exact = corrected(read.mechanism, MAX_ANGLE)
    # the assembly in which every command starts it, if it is not its start
    initial, note = started(read, exact.mechanism)
    return replace(read, nearest=state_of(read, initial)) if note else read


def _source(model: Any, loops: str | PathLike[str] | None) -> "MujocoInput | None":
    """Return the path or object of a model that MuJoCo compiles, with its own angles; None for any other."""
    # of a solver
    model = getattr(getattr(model, "source", None), "spec", model)
    named = fspath(model) if isinstance(model, str | PathLike) else model
    closed = with_loops(named, None if loops is None else fspath(loops))
    if isinstance(closed, str):
        # let MuJoCo report what is wrong with a file of unknown suffix
        if not closed.lower().endswith((".xml", ".urdf")) and (
            not Path(closed).suffix or file_reader(closed) is not None
        ):
            return None
    elif type(closed).__name__ not in ("UrdfFile", "MjSpec", "MjModel"):
        return None
    return closed


def with_exact_angles(source: "MujocoInput", exact: Corrected) -> "MujocoInput":
    """Return a file or an object in which the rounded angles are exact that lock its loops."""
    from mechsim.simulation.mjcf_reader.parsed_file import ExactAngles

    return source if exact.finding is None else ExactAngles(source, exact.changes, exact.finding)


def printed(unread: Iterable[Finding]) -> list[str]:
    """Return a line for each finding on what was not read or was corrected, without harmless parts."""
    return [
        finding.one_line for finding in unread if finding.remedy != HARMLESS or finding.kind == "redundant"
    ]


def with_loops(model: Any, loops: str | None) -> Any:
    """Return a URDF file with the loop closures of a sidecar file; without one the model.

    Raises:
        InputError: for a model that is no such file.
    """
    if loops is None:
        return model
    from mechsim.simulation.mjcf_reader.file_text import UrdfFile

    if not isinstance(model, str) or not model.lower().endswith((".urdf", ".xml")):
        raise InputError(f"{model} is no URDF file, whose loops {loops} could close; name one")
    return UrdfFile(model, loops)


def started(model: "MjcfModel", mechanism: Mechanism) -> tuple[Mechanism, str]:
    """Return a mechanism in its assembly nearest to the file's start, within its ranges, and a note on it.

    A start within them with nearly closed loops stays that of the file.
    """
    values, locked = mechanism.guess_coordinates, mechanism.locked
    started = replace(mechanism, locked={name: values[name] for name in locked})
    # joint values moved to the nearest end of their ranges
    unlimited = (-np.inf, np.inf)
    inside = {
        name: float(np.clip(value, *model.limits.get(name, unlimited))) for name, value in values.items()
    }
    if inside != values:
        with suppress(AssemblyError):
            moved = with_requested_start(started, inside)
            reached = start_poses(moved)[1]
            outside = [name for name in values if inside[name] != values[name]]
            listed = ", ".join(f"{name} = {reached[name]:.4g} {mechanism.unit(name)}" for name in outside)
            note = f"{', '.join(outside)} start outside their ranges in the file; mechsim starts at {listed}"
            coordinates = {name: reached[name] for name in values}
            return replace(moved, locked=locked, guess_coordinates=coordinates), note
    nearest, note = closed_start(started)
    if not note:
        return mechanism, ""
    unlocked, unlocked_note = closed_start(replace(started, locked={}))
    with suppress(AssemblyError):
        # a joint locked at its initial value stays where the file is assembled if its own values do not close
        reached = start_poses(unlocked)[1]
        locked = {name: reached[name] if value == values[name] else value for name, value in locked.items()}
        nearest, note = unlocked, unlocked_note
    return replace(nearest, locked=locked), note


def state_of(model: "MjcfModel", mechanism: Mechanism) -> Array:
    """Return the initial state of a model whose mechanism starts in its guess, (nq,)."""
    from mechsim.simulation.mjcf.compiling import compiled
    from mechsim.simulation.mjcf_reader.reading import states_of

    values = {name: np.array([value]) for name, value in mechanism.guess_coordinates.items()}
    links = {name: Pose(pose.position[None], pose.rotation[None]) for name, pose in mechanism.guess.items()}
    return states_of(compiled(model.spec.copy()), values, links)[0]
