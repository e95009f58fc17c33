"""Parametric models: mechanisms that differ only in their dimensions."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from mechsim.errors import InputError
from mechsim.kinematics.vector_method.rotations import turned_by
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import End, Joint
from mechsim.mechanism.link_poses import guessed_poses
from mechsim.mechanism.links import AXES, GROUND, IDENTITY, vector
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array

if TYPE_CHECKING:
    from mechsim.kinematics.solvers import KinematicSolver
    from mechsim.mechanism.forces import Forces


@dataclass(frozen=True, slots=True)
class Dimension:
    """A dimension of a mechanism.

    Attributes:
        name: its name.
        value: its value in SI.
        unit: "m", "rad" or "1".
        declared: unit that a file declares for it; empty if it is no parameter of a file.
        uncertainty: largest deviation to either side in SI that a file states; None if it states none.
        source: where the value comes from; empty if the file does not state it.
    """

    name: str
    value: float
    unit: str
    declared: str = ""
    uncertainty: float | None = None
    source: str = ""


@dataclass(frozen=True)
class DesignFamily:
    """A parametric model: mechanisms that differ only in their dimensions.

    Attributes:
        name: name of the mechanism.
        dimensions: name -> dimension with its present value.
        describe: returns the description for changed dimensions, name -> value in SI; it may be one that
            cannot be assembled.
        make: returns the checked solver for the same.
        forces: returns the forces for the same, None if the file defines none; None for a model without
            forces.
        usual: default selection of dimensions; empty for all.
        derived: dimension -> dimensions from which its default value is computed.
        intended_use: question that the model answers; empty if its source states none.
    """

    name: str
    dimensions: Mapping[str, Dimension]
    describe: Callable[[Mapping[str, float]], Mechanism]
    make: Callable[[Mapping[str, float]], KinematicSolver]
    forces: Callable[[Mapping[str, float]], Forces | None] | None = None
    usual: tuple[str, ...] = ()
    derived: Mapping[str, frozenset[str]] = field(default_factory=dict[str, frozenset[str]])
    intended_use: str = ""

    @property
    def uncertainties(self) -> dict[str, float]:
        """The uncertainties that the file states: dimension -> largest deviation to either side, in SI."""
        stated = {name: dimension.uncertainty for name, dimension in self.dimensions.items()}
        return {name: value for name, value in stated.items() if value is not None}

    def require_independent(self, names: Collection[str]) -> None:
        """Raise InputError for dimensions of which one is computed from another.

        Raises:
            InputError: names both.
        """
        for name in names:
            for other in self.derived.get(name, frozenset()) & {*names}:
                raise InputError(
                    f"{self.name}: {name} is computed from {other}, so that they cannot both vary; "
                    "leave one of them out"
                )

    def values(self) -> dict[str, float]:
        """Return the present dimensions in SI."""
        return {name: dimension.value for name, dimension in self.dimensions.items()}


def own_designs(solver: KinematicSolver) -> DesignFamily:
    """Return the designs of a mechanism by its own dimensions; without any, by its joint positions."""
    formula = solver.closed_form
    if formula is None or not solver.dimensions:
        return placed_designs(solver)
    dimensions = {name: Dimension(name, value, unit) for name, (value, unit) in solver.dimensions.items()}

    def describe(values: Mapping[str, float]) -> Mechanism:
        # unchecked, and without a guess: such a design may be one that cannot be assembled
        return formula.with_dimensions(values, checked=False).described

    return DesignFamily(solver.name, dimensions, describe, solver.with_dimensions)


def placed_designs(solver: KinematicSolver) -> DesignFamily:
    """Return the designs of a mechanism whose dimensions are the positions of its joints."""
    mechanism = solver.mechanism

    def describe(values: Mapping[str, float]) -> Mechanism:
        return _placed(mechanism, values)

    def make(values: Mapping[str, float]) -> KinematicSolver:
        return solver.with_mechanism(describe(values)) if values else solver

    dimensions = {
        name: Dimension(name, value, unit)
        for joint in mechanism.joints
        for name, value, unit in _joint_dimensions(joint)
    }
    usual = tuple(name for name in dimensions if name.count(".") == 2 and ".at." in name)
    return DesignFamily(solver.name, dimensions, describe, make, usual=usual)


def _joint_dimensions(joint: Joint) -> list[tuple[str, float, str]]:
    """Return name, value and unit of each dimension of a joint."""
    ends = {"": joint.b, ".a": joint.a, ".b": joint.b}
    dimensions = [
        (f"{joint.name}{side}.at.{axis}", end.point[i], "m")
        for side, end in ends.items()
        for i, axis in enumerate(AXES)
    ]
    return dimensions + [(f"{joint.name}{side}.tilt.{axis}", 0.0, "rad") for side in ends for axis in AXES]


def _placed(mechanism: Mechanism, values: Mapping[str, float]) -> Mechanism:
    """Return a mechanism with changed joint positions and tilts."""
    before = {joint.name: joint for joint in mechanism.joints}
    joints = {**before}
    for name, value in values.items():
        joint, what, axis = name.rsplit(".", 2)
        side = ""
        if joint not in joints or (joint[:-2] in joints and joint[-2:] in (".a", ".b")):
            joint, side = joint[:-2], joint[-1:]
        i = AXES.index(axis)
        start = (before[joint].a if side == "a" else before[joint].b).point[i] if what == "at" else 0.0
        change = (value - start) * np.eye(3)[i]
        moved = joints[joint]
        frames = {side: np.eye(3)} if side else {"a": _between(mechanism, moved), "b": np.eye(3)}
        ends = {key: _end(getattr(moved, key), what, frame @ change) for key, frame in frames.items()}
        joints[joint] = replace(moved, **ends)
    return replace(mechanism, joints=tuple(joints.values()))


def _between(mechanism: Mechanism, joint: Joint) -> Array:
    """Return the rotation from link b's frame to link a's at which both sides of a joint coincide."""
    if KINDS[joint.kind].aligned:
        return joint.a.frame @ joint.b.frame.T
    poses = {GROUND: IDENTITY, **guessed_poses(mechanism)}
    return poses[joint.a.link].rotation.T @ poses[joint.b.link].rotation


def _end(end: End, what: str, change: Array) -> End:
    if what == "at":
        return replace(end, point=vector(np.asarray(end.point) + change))
    frame = turned_by(end.frame[None], change[None])[0]
    return End(end.link, end.point, vector(frame[:, 2]), vector(frame[:, 0]))
