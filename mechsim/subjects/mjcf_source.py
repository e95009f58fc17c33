"""A mechanism from an MJCF file, solved by mechsim's loop equations; MuJoCo can run the file itself."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from os import PathLike, fspath
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim import units
from mechsim.analytic.loops.mobility import undetermined_joints
from mechsim.analytic.loops.rounded_geometry import MAX_ANGLE, Corrected, corrected
from mechsim.analytic.loops.start import ClosedStart, closed_start, start_poses, with_requested_start
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import AssemblyError, InputError, MechsimError
from mechsim.model.finding import HARMLESS, Finding
from mechsim.model.links import Pose
from mechsim.model.mechanism import Mechanism, against
from mechsim.model.motion_laws import make_motion_laws, steady
from mechsim.numerics.arrays import Array
from mechsim.numerics.rounding import ROUNDING
from mechsim.subjects.model_source import ModelDescription, ModelSource, Prescription, file_reader
from mechsim.units import Unit

if TYPE_CHECKING:
    from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel
    from mechsim.simulation.mjcf_reader.parsed_file import MujocoInput


@dataclass(frozen=True)
class MujocoSource(ModelSource):
    """A model that MuJoCo compiles.

    Attributes:
        model: path of an MJCF or URDF file, or an object.
    """

    model: "MujocoInput"

    def describe(self, changed: Mapping[str, str | float], prescription: Prescription) -> ModelDescription:
        """Return the mechanism with locks, keyframe and tracked points, without motion laws."""
        if changed:
            raise InputError(f"{self.model}: an MJCF file has no parameters; leave out --set")
        solver = read_mjcf(
            with_loops(self.model, prescription.loops),
            drivers=tuple(prescription.drive),
            lock=prescription.lock,
            fix_base=prescription.fix_base,
            key=prescription.key,
            track=prescription.track,
            still=prescription.still,
            start=prescription.start,
        )
        return ModelDescription(solver, prescribed=True)


def mujoco_input(model: Any, loops: str | PathLike[str] | None = None) -> "MujocoInput | None":
    """Return the path or object of a model that MuJoCo compiles; None for any other model.

    Rounded angles that lock its loops are exact in it.

    Args:
        model: as in `load`; for a solver that was read from MJCF, the specification that it runs.
        loops: path of a sidecar file with the loop closures of a URDF file.

    Raises:
        InputError: for `loops` with another model.
    """
    if isinstance(model, KinematicSolver) and model.source is not None:
        model = model.source.spec
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
    from mechsim.simulation.mjcf_reader.reading import read_model

    with suppress(MechsimError):
        return _with_exact_angles(closed, corrected(read_model(closed, lint=True).mechanism))
    return closed


def _with_exact_angles(source: "MujocoInput", exact: Corrected) -> "MujocoInput":
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
    from mechsim.simulation.mjcf_reader.urdf_loops import UrdfFile

    if not isinstance(model, str) or not model.lower().endswith((".urdf", ".xml")):
        raise InputError(f"{model} is no URDF file, whose loops {loops} could close; name one")
    return UrdfFile(model, loops)


def read_mjcf(
    source: "MujocoInput",
    *,
    drivers: Sequence[str] = (),
    lock: Mapping[str, str | float | None] | None = None,
    fix_base: bool = False,
    key: str | None = None,
    track: Sequence[str] = (),
    still: bool = False,
    start: Mapping[str, str | float] | None = None,
) -> KinematicSolver:
    """Return the mechanism of a model that MuJoCo compiles.

    Args:
        source: path of an MJCF or URDF file, or an object.
        drivers: driven joints; empty selects those with actuators, else a hinge called crank.
        lock: joint -> value at which it is locked, as text or in SI; None is its initial value.
        fix_base: whether bodies with free joints are fixed.
        key: keyframe to start from; the default is the reference configuration.
        track: NAME of a site or body, or NAME,BODY@x,y,z in [m]; empty selects the named sites, or the
            origins of bodies if there are none.
        still: whether the model may have no driver, because it is only described.
        start: joint -> value as text or in SI; the nearest assembly is the initial one.

    Raises:
        InputError: for models that MuJoCo rejects, or an unknown joint, keyframe or point; one line.
        AssemblyError: where a joint cannot reach the value at which it is locked.
    """
    from mechsim.simulation.mjcf_reader.parsed_file import model_label
    from mechsim.simulation.mjcf_reader.reading import read_model

    values = {
        name: _parser(name, value) if isinstance(value, str) else value
        for name, value in (lock or {}).items()
    }

    def read(described: "MujocoInput") -> "MjcfModel":
        return read_model(
            described,
            drivers=drivers,
            lock=values,
            fix_base=fix_base,
            key=key,
            track=track,
            describe_only=still,
        )

    try:
        model = read(source)
    except InputError as error:
        label = model_label(source)
        raise error if label in str(error) else InputError(f"{label}: {error}") from None
    exact = corrected(model.mechanism)
    if exact.finding is not None:
        model = read(_with_exact_angles(source, exact))
        exact = corrected(model.mechanism, MAX_ANGLE)
    # pictures of a scene without gravity have z up, too
    mechanism = exact.mechanism
    if start:
        from mechsim.subjects.requested_start import started_near

        mechanism = started_near(mechanism, start)
    initial = _started(model, mechanism)
    if initial.note or start:
        model = replace(model, qpos=_state(model, initial.mechanism))
    mechanism = replace(_with_locked_guess(initial.mechanism), up=against(model.forces.gravity) or "z")
    return KinematicSolver(
        mechanism,
        forces=model.forces,
        source=model,
        ranges=model.limits,
        facts=(
            *model.remarks,
            *printed(model.unread),
            *_initial_gap(model),
            *exact.facts,
            *filter(None, [initial.note]),
        ),
        corrected=(exact.moved, exact.rotated),
    )


def _started(model: "MjcfModel", mechanism: Mechanism) -> ClosedStart:
    """Return a mechanism in its assembly nearest to the file's start, within the ranges of its joints.

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
            return ClosedStart(replace(moved, locked=locked, guess_coordinates=coordinates), note)
    start = closed_start(started)
    if not start.note:
        return ClosedStart(mechanism)
    unlocked = closed_start(replace(started, locked={}))
    with suppress(AssemblyError):
        # a joint locked at its initial value stays where the file is assembled if its own values do not close
        reached = start_poses(unlocked.mechanism)[1]
        locked = {name: reached[name] if value == values[name] else value for name, value in locked.items()}
        start = unlocked
    return ClosedStart(replace(start.mechanism, locked=locked), start.note)


def with_nearest_assembly(model: "MjcfModel") -> "MjcfModel":
    """Return a model with the assembly in which every command starts it, if it is not its start."""
    initial = _started(model, corrected(model.mechanism, MAX_ANGLE).mechanism)
    return replace(model, nearest=_state(model, initial.mechanism)) if initial.note else model


def _state(model: "MjcfModel", mechanism: Mechanism) -> Array:
    """Return the initial state of a model whose mechanism starts in its guess, (nq,)."""
    from mechsim.simulation.mjcf.compiling import compiled
    from mechsim.simulation.mjcf_reader.reading import states_of

    values = {name: np.array([value]) for name, value in mechanism.guess_coordinates.items()}
    links = {name: Pose(pose.position[None], pose.rotation[None]) for name, pose in mechanism.guess.items()}
    return states_of(compiled(model.spec.copy()), values, links)[0]


def _parser(name: str, text: str) -> Callable[[Unit], float]:
    return lambda unit: units.parse_coordinate(text, unit, f"the locked position of {name}")


def _initial_gap(model: "MjcfModel") -> list[str]:
    """Return a sentence on the initial loop-closure error of a file; empty for rounding."""
    if model.gap <= 1e-12 * model.mechanism.characteristic_length:
        return []
    return [
        f"the initial loop-closure error of the file is {model.gap:.2g} m; "
        "the solution closes the loops exactly"
    ]


def _with_locked_guess(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose guess has its joints at their locked values, at constant driver positions."""
    guess_coordinates, locked = dict(mechanism.guess_coordinates), dict(mechanism.locked)
    displaced = {
        name: value for name, value in locked.items() if abs(value - guess_coordinates[name]) > ROUNDING
    }
    if not displaced:
        return replace(mechanism, guess_coordinates=guess_coordinates | locked)
    drivers = (*mechanism.drivers, *locked)
    unlocked = replace(mechanism, driver=drivers, locked={})
    # what the drivers leave undetermined stays on the path, and is free afterwards
    still = {
        name: guess_coordinates[name] for name in undetermined_joints(unlocked) if name in guess_coordinates
    }
    unlocked = replace(unlocked, locked=still)
    states = {
        name: steady(
            guess_coordinates[name], displaced.get(name, guess_coordinates[name]) - guess_coordinates[name]
        )
        for name in drivers
    }
    laws = make_motion_laws(unlocked, states, 1.0)
    try:
        motion = KinematicSolver(unlocked, motion_laws=laws).solve(t=[1.0])
    except MechsimError as error:
        targets = ", ".join(f"{name} = {value:g}" for name, value in displaced.items())
        raise type(error)(f"on the path to the locked position {targets}: {error}") from None
    poses = {
        name: Pose(np.array(link.position[0]), np.array(link.rotation[0]))
        for name, link in motion.links.items()
    }
    guess_coordinates |= {
        name: float(motion.joints[name].value[0]) for name in guess_coordinates if name in motion.joints
    }
    return replace(mechanism, guess=poses, guess_coordinates=guess_coordinates | locked)
