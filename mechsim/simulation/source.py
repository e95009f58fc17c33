"""Reads a mechanism or a custom model and returns the assembled model."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import mujoco
import numpy as np

from mechsim.errors import AssemblyError, InputError
from mechsim.mechanism.joint_kinds import KINDS, antiparallel_message
from mechsim.mechanism.link_poses import guessed_poses
from mechsim.mechanism.links import GROUND, IDENTITY, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.scene import Scene
from mechsim.numerics.arrays import Array
from mechsim.simulation.closed_model import ClosedModel
from mechsim.simulation.custom_model import closed_loops, closed_state, from_file, from_spec
from mechsim.simulation.mjcf.compiling import quiet
from mechsim.simulation.mjcf.generator import generate
from mechsim.simulation.mjcf.joints import CRANK, PASSIVE_CRANK, model_names
from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel
from mechsim.simulation.model_loops import ModelLoops


class HasMechanism(Protocol):
    """An object with a mechanism description, such as a catalogue mechanism."""

    @property
    def mechanism(self) -> Any:
        """The description, a `Mechanism`; its type is checked on use."""
        ...


Model = Mechanism | mujoco.MjSpec | mujoco.MjModel | str | os.PathLike[str]
Source = Model | HasMechanism | MjcfModel


def from_source(
    source: Source,
    scene: Scene | None = None,
    *,
    drivers: Sequence[str] | str | None = None,
    lock: Mapping[str, float | None] | None = None,
    key: str | None = None,
) -> ClosedModel:
    """Return the closed model of a mechanism or a custom model, for a run.

    Args:
        source: the mechanism or model.
        scene: contents of the model of a mechanism; a scene without forces gets the forces of the source.
        drivers: for a custom model, the hinge that is the crank, or a sequence of joints that follow motion
            laws; None for the hinge "crank". For a mechanism, a sequence if its crank follows a motion law;
            several drivers always do.
        lock: joint of a custom model -> value at which it is locked, in [m] or [rad]; None for its initial
            value, the only choice for a ball or a free joint.
        key: initial keyframe of a custom model; None for its reference configuration.

    Raises:
        InputError: if the model cannot be read, or a mechanism has no point to track.
        AssemblyError: if its loops do not close at the drivers' initial values.
    """
    # the MJCF model that a source is or contains; otherwise None
    candidates = (source, getattr(source, "source", None))
    read = next((candidate for candidate in candidates if isinstance(candidate, MjcfModel)), None)
    if read is not None:
        closed = _from_read_model(source, read, drivers)
    elif not isinstance(model := description(source), Mechanism):
        from mechsim.simulation.mjcf_reader.reading import read_model

        read = read_model(_parsed(model), lock=lock, key=key, describe_only=True)
        closed = from_file(read, CRANK if drivers is None else drivers)
        closed = replace(closed, note="; ".join(read.remarks))
    else:
        spec = assembled(model, (scene or Scene()).under(getattr(source, "forces", None)))
        require_points(model)
        follows_laws = not model.has_crank or not (drivers is None or isinstance(drivers, str))
        closed = from_mechanism(model, spec, tuple(model.points), follows_laws=follows_laws)
    change_point = getattr(source, "change_point", "smooth")
    return replace(closed, loops=replace(closed.loops, change_point=change_point))


def require_points(mechanism: Mechanism) -> None:
    """Raise InputError for a mechanism without tracked points."""
    if not mechanism.points:
        raise InputError("the model has no point to track; list one under [points]")


def _parsed(model: Any) -> Any:
    """Return the specification of MJCF text; the path of a file or an object of MuJoCo remains."""
    if not isinstance(model, str) or "<" not in model:
        return os.fspath(model) if isinstance(model, os.PathLike) else model
    try:
        return mujoco.MjSpec.from_string(model)
    except ValueError as error:
        raise InputError(f"MuJoCo cannot read the model: {' '.join(str(error).split())}") from error


def _from_read_model(source: Source, read: MjcfModel, drivers: Sequence[str] | str | None) -> ClosedModel:
    """Return the model of an MJCF file, or of the corrected mechanism if its loops do not close.

    The corrected mechanism has displaced joints with which the loops close.
    """
    try:
        return from_file(read, drivers)
    except AssemblyError:
        corrected = getattr(source, "mechanism", read.mechanism)
        if corrected is read.mechanism or not isinstance(corrected, Mechanism):
            raise
    note = (
        "with the digits of the file its loops close in no pose: the run uses the mechanism read from it, "
        "its joints moved until they close, without the file's masses, contacts and actuators"
    )
    return replace(from_source(corrected, drivers=drivers), note=note)


def from_mechanism(
    mechanism: Mechanism, spec: mujoco.MjSpec, points: tuple[str, ...], *, follows_laws: bool
) -> ClosedModel:
    """Return the model generated from a mechanism; `follows_laws` if its drivers follow motion laws."""
    # joint of the model -> coordinate and its index in the joint; a single crank is named "crank"
    name_of = model_names(mechanism)
    called: dict[str, tuple[str, int | None]] = {
        name_of[name]: (name, i if len(joint.coordinates) > 1 else None)
        for joint in mechanism.joints
        for i, name in enumerate(joint.coordinates)
        if name in name_of
    }
    named = called if follows_laws or PASSIVE_CRANK in called else called | {CRANK: (CRANK, None)}
    drivers = tuple(name_of[name] for name in mechanism.drivers) if follows_laws else CRANK
    closed = from_spec(spec, points, drivers, coordinates=named, laws=mechanism.named_laws)
    hidden = frozenset(closed.track.links) - {link.name for link in mechanism.links}
    return replace(closed, track=replace(closed.track, hidden=hidden))


def description(source: Source) -> Model:
    """Return the mechanism of an object that has one, or the model itself.

    Raises:
        InputError: if the object is no model.
    """
    model = getattr(source, "mechanism", source)
    if not isinstance(model, Mechanism | mujoco.MjSpec | mujoco.MjModel | str | os.PathLike):
        raise InputError(
            f"a {type(source).__name__} cannot be simulated; give a mechanism, one of the catalogue, "
            "an MJCF file or a specification"
        )
    return model


@quiet()
def assembled(mechanism: Mechanism, scene: Scene) -> mujoco.MjSpec:
    """Return the model of a mechanism with its loops closed in the reference configuration.

    The crank is at the mechanism's `start`. The model solves its own assembly from the initial guess, which
    selects the assembly mode; lengths come from the description only.

    Raises:
        AssemblyError: if the loops do not close.
    """
    loops, guess = initial_guess(mechanism, scene)
    many = link_poses(mechanism, loops, closed_state(loops, guess)[None])
    poses = {name: pose.select(0) for name, pose in many.items()}
    # reject a mechanism with antiparallel axes of a joint, which point constraints allow
    all_poses = {GROUND: IDENTITY, **poses}
    for joint in mechanism.joints:
        for i in KINDS[joint.kind].aligned_columns:
            a, b = (all_poses[end.link].rotation @ end.frame[:, i] for end in (joint.a, joint.b))
            if not float(np.dot(a, b)) > 0.0:
                raise AssemblyError(f"{mechanism.name}: {antiparallel_message(joint.name, i)}")
    return generate(mechanism, scene, poses)


def link_poses(mechanism: Mechanism, loops: ModelLoops, states: Array) -> dict[str, Pose]:
    """Return n poses of each link at states (n, nq) of a model whose bodies have the links' names."""
    position, rotation = loops.posed.body_poses(states)
    bodies = {link.name: loops.model.body(link.name).id for link in mechanism.links}
    return {name: Pose(position[:, body], rotation[:, body]) for name, body in bodies.items()}


def initial_guess(mechanism: Mechanism, scene: Scene) -> tuple[ModelLoops, Array]:
    """Return the model of the mechanism's initial guess, and its state at `start`, (nq,).

    The loops are not closed in that state.
    """
    spec = generate(mechanism, scene, guessed_poses(mechanism))
    loops = closed_loops(spec, CRANK if mechanism.has_crank else mechanism.drivers, mechanism.named_laws)
    guess = loops.model.qpos0.copy()
    if loops.drivers.crank:
        guess[loops.crank_address] = mechanism.start
    for name, address in zip(loops.drivers.names, loops.drivers.addresses, strict=True):
        guess[address] = mechanism.guess_coordinates.get(name, guess[address])
    return replace(loops, drivers=loops.drivers.locked_at(guess[loops.drivers.addresses])), guess
