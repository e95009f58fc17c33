"""A mechanism from an MJCF file, solved by mechsim's loop equations; MuJoCo can run the file itself."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from mechsim import units
from mechsim.errors import InputError, MechsimError
from mechsim.io.model_source import ModelDescription, ModelSource, Prescription
from mechsim.io.mujoco_inputs import printed, started, state_of, with_exact_angles, with_loops
from mechsim.kinematics.loops.rounded_geometry import MAX_ANGLE, corrected
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.links import Pose
from mechsim.mechanism.mechanism import Mechanism, against
from mechsim.mechanism.motion_laws import make_motion_laws, steady
from mechsim.numerics.arrays import ROUNDING

if TYPE_CHECKING:
    from mechsim.simulation.mjcf_reader.mjcf_model import MjcfModel
    from mechsim.simulation.mjcf_reader.parsed_file import MujocoInput

# no request of a user
AS_WRITTEN = Prescription()


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
        solver = read_mjcf(with_loops(self.model, prescription.loops), prescription)
        return ModelDescription(solver, prescribed=True)


def read_mjcf(source: "MujocoInput", request: Prescription = AS_WRITTEN) -> KinematicSolver:
    """Return the mechanism of a model that MuJoCo compiles.

    Args:
        source: path of an MJCF or URDF file, or an object.
        request: its drivers, without their motion laws; none selects the joints with actuators, else a hinge
            called crank. Locks, keyframe, start, and the points to track in [m]: none selects the named
            sites, or the origins of bodies if there are none.

    Raises:
        InputError: for models that MuJoCo rejects, or an unknown joint, keyframe or point; one line.
        AssemblyError: where a joint cannot reach the value at which it is locked.
    """
    from mechsim.simulation.mjcf_reader.parsed_file import model_label
    from mechsim.simulation.mjcf_reader.reading import read_model

    # text is read when the unit of its coordinate is known
    values = {
        name: partial(units.parse_coordinate, value, name=f"the locked position of {name}")
        if isinstance(value, str)
        else value
        for name, value in request.lock.items()
    }

    def read(described: "MujocoInput") -> "MjcfModel":
        return read_model(
            described,
            drivers=tuple(request.drive),
            lock=values,
            fix_base=request.fix_base,
            key=request.key,
            track=request.track,
            describe_only=request.still,
        )

    try:
        model = read(source)
    except InputError as error:
        label = model_label(source)
        raise error if label in str(error) else InputError(f"{label}: {error}") from None
    exact = corrected(model.mechanism)
    if exact.finding is not None:
        model = read(with_exact_angles(source, exact))
        exact = corrected(model.mechanism, MAX_ANGLE)
    # pictures of a scene without gravity have z up, too
    mechanism = exact.mechanism
    if request.start:
        from mechsim.io.requested_start import started_near

        mechanism = started_near(mechanism, request.start)
    initial, note = started(model, mechanism)
    if note or request.start:
        model = replace(model, qpos=state_of(model, initial))
    mechanism = replace(_with_locked_guess(initial), up=against(model.forces.gravity) or "z")
    facts = [*model.remarks, *printed(model.unread), *_initial_gap(model, request.key), *exact.facts]
    return KinematicSolver(
        mechanism,
        forces=model.forces,
        source=model,
        ranges=model.limits,
        facts=(*facts, *filter(None, [note])),
        corrected=(exact.moved, exact.rotated),
    )


def _initial_gap(model: "MjcfModel", key: str | None) -> list[str]:
    """Return a sentence on the initial loop-closure error of a file; empty for rounding."""
    if model.gap <= 1e-12 * model.mechanism.characteristic_length:
        return []
    others = "" if key or not model.keyframes else f"; --key starts at {' or '.join(model.keyframes)}"
    return [
        f"the initial loop-closure error of the file is {model.gap:.2g} m; "
        f"solved configurations close the loops as exactly as its dimensions allow{others}"
    ]


def _with_locked_guess(mechanism: Mechanism) -> Mechanism:
    """Return a mechanism whose guess has its joints at their locked values, at constant driver positions."""
    guess_coordinates, locked = dict(mechanism.guess_coordinates), dict(mechanism.locked)
    changes = {name: value - guess_coordinates[name] for name, value in locked.items()}
    displaced = {name: locked[name] for name, change in changes.items() if abs(change) > ROUNDING}
    if not displaced:
        return replace(mechanism, guess_coordinates=guess_coordinates | locked)
    from mechsim.kinematics.loops.joint_locks import undetermined_joints

    drivers = (*mechanism.drivers, *locked)
    unlocked = replace(mechanism, driver=drivers, locked={})
    # what the drivers leave undetermined stays on the path, and is free afterwards
    still = {
        name: guess_coordinates[name] for name in undetermined_joints(unlocked) if name in guess_coordinates
    }
    unlocked = replace(unlocked, locked=still)
    rates = {name: changes[name] for name in displaced}
    states = {name: steady(guess_coordinates[name], rates.get(name, 0.0)) for name in drivers}
    laws = make_motion_laws(unlocked, states, 1.0)
    try:
        motion = KinematicSolver(unlocked, motion_laws=laws).solve(t=[1.0])
    except MechsimError as error:
        targets = ", ".join(f"{name} = {value:g}" for name, value in displaced.items())
        raise type(error)(f"on the path to the locked position {targets}: {error}") from None
    moved = motion.links.items()
    poses = {name: Pose(np.array(link.position[0]), np.array(link.rotation[0])) for name, link in moved}
    reached = {name: float(joint.value[0]) for name, joint in motion.joints.items()}
    guess_coordinates |= {name: reached[name] for name in guess_coordinates if name in reached}
    return replace(mechanism, guess=poses, guess_coordinates=guess_coordinates | locked)
