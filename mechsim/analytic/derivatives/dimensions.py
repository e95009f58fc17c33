"""Derivatives of the numbers of a mechanism by its dimensions."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache, cached_property
from typing import Any

import numpy as np

from mechsim.analytic.solvers import KinematicSolver
from mechsim.analytic.vector_method.rotations import turned_by
from mechsim.errors import InputError, MechsimError
from mechsim.model.coupling_functions import TabledFunction, WrittenFunction
from mechsim.model.forces import Forces, Friction, JointSpring, Load, Spring
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import Coupling, End, Joint
from mechsim.model.link_poses import guessed_poses
from mechsim.model.links import GROUND, IDENTITY, Inertia, Link, Vector
from mechsim.model.mechanism import Mechanism
from mechsim.model.nonlinear_springs import NonlinearSpring, SoftStop, SpringLaw
from mechsim.model.quantity import AXES
from mechsim.numerics.arrays import Array

# fields with numbers on which motions and forces depend, besides those of curves and cams (NUMBERS); load
# profiles over angle or time have none
NUMBER_FIELDS: Mapping[type, tuple[str, ...]] = {
    Joint: ("a", "b", "cross_angle", "length"),
    End: ("point", "axis", "reference"),
    Coupling: ("left", "right", "coefficients", "zeros", "pressure_angle", "function"),
    WrittenFunction: ("values",),
    TabledFunction: ("positions", "targets"),
    Link: ("inertia",),
    Inertia: ("mass", "centre", "moments"),
    Forces: ("gravity", "flywheel", "friction", "springs", "joint_springs", "nonlinear_springs", "loads"),
    Friction: ("viscous", "coulomb", "viscous_turn", "coulomb_turn"),
    Spring: ("a", "b", "stiffness", "rest", "damping"),
    JointSpring: ("stiffness", "rest"),
    NonlinearSpring: ("ends", "law"),
    SoftStop: ("limit", "stiffness", "damping"),
    SpringLaw: ("stiffness", "rest", "damping", "preload", "values", "table"),
    Load: ("location",),
}


@dataclass(frozen=True)
class GivenMechanism(Mechanism):
    """A mechanism with given numbers and characteristic length, without checks: numbers can be complex.

    All couplings, with those of gears and screws, are `couplings`.
    """

    given_length: float = 1.0

    def __post_init__(self) -> None: ...

    @cached_property
    def characteristic_length(self) -> float:
        """Its given characteristic length, in [m]."""
        return self.given_length

    @property
    def laws(self) -> tuple[Coupling, ...]:
        """All couplings, with those of gears and screws."""
        return self.couplings


@cache
def _unchecked(kind: type) -> type:
    """Return a class of descriptions without its checks, because numbers can be complex."""
    members: dict[str, Any] = {"__slots__": (), "__post_init__": lambda _: None}
    if kind is End:
        # not cached: equal real and complex numbers are the same key of a cache
        members["frame"] = property(
            lambda end: np.column_stack([end.reference, np.cross(end.axis, end.reference), end.axis])
        )
    return type(kind.__name__, (kind,), members)


def _renumbered(description: Any, number: Callable[[float], Any]) -> Any:
    """Return a description with each of its numbers replaced by a function of it."""
    if isinstance(description, int | float):
        return number(float(description))
    if isinstance(description, tuple):
        return tuple(_renumbered(entry, number) for entry in description)
    if isinstance(description, Mapping):
        return {key: _renumbered(entry, number) for key, entry in description.items()}
    kind = next((kind for kind in NUMBER_FIELDS if isinstance(description, kind)), None)
    names = getattr(description, "NUMBERS", ()) if kind is None else NUMBER_FIELDS[kind]
    if not names:
        return description
    kind = kind or type(description)
    copy: Any = object.__new__(_unchecked(kind))
    for name in (entry.name for entry in fields(kind)):
        value = getattr(description, name)
        object.__setattr__(copy, name, _renumbered(value, number) if name in names else value)
    return copy


def _numbers(description: object) -> Array:
    numbers: list[float] = []

    def listed(number: float) -> float:
        numbers.append(number)
        return number

    _renumbered(description, listed)
    return np.array(numbers)


def _with(description: object, numbers: Array) -> Any:
    following = iter(numbers.tolist())
    return _renumbered(description, lambda _: next(following))


def _described(mechanism: Mechanism) -> tuple[object, ...]:
    return mechanism.joints, mechanism.links, mechanism.points, mechanism.locked, mechanism.laws


def numbers_of(mechanism: Mechanism) -> Array:
    """Return all numbers on which the motion and the forces of a mechanism depend, (k,) in SI."""
    return _numbers(_described(mechanism))


def with_numbers(mechanism: Mechanism, numbers: Array) -> GivenMechanism:
    """Return a mechanism with other numbers, (k,) in the order of `numbers_of`, complex or real.

    Its characteristic length stays that of the original.
    """
    joints, links, points, locked, laws = _with(_described(mechanism), numbers)
    own = {field.name: getattr(mechanism, field.name) for field in fields(mechanism)}
    own |= {"joints": joints, "links": links, "points": points, "locked": locked, "gears": ()}
    own |= {"couplings": laws, "given_length": mechanism.characteristic_length}
    return GivenMechanism(**own)


def force_numbers(forces: Forces) -> Array:
    """Return the numbers of forces, (k,) in SI, without load profiles over angle or time."""
    return _numbers(forces)


def with_force_numbers(forces: Forces, numbers: Array) -> Forces:
    """Return forces with other numbers, (k,) in the order of `force_numbers`."""
    renumbered: Forces = _with(forces, numbers)
    return renumbered


# weights of the values 1 to 4 steps ahead (and negative ones behind), divided by the step
EIGHTH = np.array([4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0])
SIXTH = np.array([3.0 / 4.0, -3.0 / 20.0, 1.0 / 60.0, 0.0])
ONE_SIDED = np.array([4.0, -3.0, 4.0 / 3.0, -1.0 / 4.0])
# steps as powers of two times the scale of a dimension, which are exact in binary numbers
POWERS = (-7, -9, -11, -13, -15)
# largest relative disagreement of two orders of difference at which no other step is tried, at which the best
# step is accepted, and of the one-sided differences
CLOSE, ACCEPTED, KINK = 1e-11, 1e-7, 1e-3
# relative length below which the step of a length is based on the characteristic length
SMALL_LENGTH = 1e-3


@dataclass(frozen=True, slots=True)
class Dimension:
    """A dimension of a mechanism.

    Attributes:
        name: its name.
        value: its value in SI.
        unit: "m", "rad" or "1".
        declared: unit that a file declares for it; empty if it is no parameter of a file.
    """

    name: str
    value: float
    unit: str
    declared: str = ""


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
    """

    name: str
    dimensions: Mapping[str, Dimension]
    describe: Callable[[Mapping[str, float]], Mechanism]
    make: Callable[[Mapping[str, float]], KinematicSolver]
    forces: Callable[[Mapping[str, float]], Forces | None] | None = None
    usual: tuple[str, ...] = ()
    derived: Mapping[str, frozenset[str]] = field(default_factory=dict[str, frozenset[str]])

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


def changes(
    designs: DesignFamily, names: Sequence[str], numbers: Callable[[Mapping[str, float]], Array] | None = None
) -> dict[str, Array]:
    """Return the derivatives of a mechanism's numbers by dimensions: name -> (k,), ordered as `numbers_of`.

    Args:
        designs: the parametric model.
        names: names of dimensions.
        numbers: changed dimensions, name -> value, to numbers; the default is the numbers of the description.

    Raises:
        InputError: where a description has a kink at a dimension, or fails for a perturbed value.

    Accuracy: a description is arithmetic. Differences of eighth order over binary steps give relative errors
        of about 1e-13, with the step at which a sixth order agrees best; a disagreement above 1e-7 is an
        error.
    """
    read_numbers = numbers or (lambda values: numbers_of(designs.describe(values)))
    length = designs.describe({}).characteristic_length
    return {name: _change(designs, designs.dimensions[name], length, read_numbers) for name in names}


def _change(
    designs: DesignFamily,
    dimension: Dimension,
    length: float,
    read_numbers: Callable[[Mapping[str, float]], Array],
) -> Array:
    def numbers(value: float) -> Array:
        return read_numbers({dimension.name: value})

    current = numbers(dimension.value)
    best, apart = current, np.inf
    for step in _steps(dimension, length):
        try:
            perturbed = [
                [numbers(dimension.value + direction * k * step) - current for k in range(1, 5)]
                for direction in (1.0, -1.0)
            ]
            derivative, off = _derivative(np.array(perturbed), step)
        except (MechsimError, ValueError):
            continue
        if off < apart:
            best, apart = derivative, off
        if apart <= CLOSE:
            return best
    if apart <= ACCEPTED:
        return best
    raise InputError(
        f"{designs.name}: the description has no derivative by {dimension.name} at {dimension.value:.6g}: "
        "it has a kink or fails for a perturbed value; change the dimension a little"
    )


def _derivative(perturbed: Array, step: float) -> tuple[Array, float]:
    """Return derivatives from the changes of numbers (k,) on both sides, (2, 4, k), and their error estimate.

    The estimate is the disagreement of a lower order, relative to the largest change; infinite at a kink.
    """
    ahead, behind = (np.tensordot(ONE_SIDED, side, 1) / step for side in perturbed)
    eighth, sixth = (np.tensordot(order, perturbed[0] - perturbed[1], 1) / step for order in (EIGHTH, SIXTH))
    most = float(np.abs(perturbed).max(initial=0.0)) / (4.0 * step)
    if most == 0.0:
        return eighth, 0.0
    smooth = np.abs(ahead + behind).max() <= KINK * most
    return eighth, float(np.abs(eighth - sixth).max()) / most if smooth else np.inf


def _steps(dimension: Dimension, length: float) -> Iterator[float]:
    """Yield steps of a dimension in SI, exact in binary numbers, the most suitable first."""
    for scale in _scales(dimension, length):
        for power in POWERS:
            yield float(2.0 ** (np.floor(np.log2(scale)) + power))


def _scales(dimension: Dimension, length: float) -> list[float]:
    """Return possible scales of the steps of a dimension, the most suitable first, in SI."""
    own = abs(dimension.value)
    if dimension.unit == "rad":
        return [1.0]
    whole = length if dimension.unit == "m" else 1.0
    return [own, whole] if own > SMALL_LENGTH * whole else [whole, own] if own else [whole]


def own_designs(solver: KinematicSolver) -> DesignFamily:
    """Return the designs of a mechanism by its own dimensions; without any, by its joint positions."""
    if not solver.dimensions:
        return placed_designs(solver)
    dimensions = {name: Dimension(name, value, unit) for name, (value, unit) in solver.dimensions.items()}
    return DesignFamily(solver.name, dimensions, solver.described_with, solver.with_dimensions)


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
    joints = {joint.name: joint for joint in mechanism.joints}
    for name, value in values.items():
        rest, what, axis = name.rsplit(".", 2)
        own = rest in joints and not (rest[:-2] in joints and rest[-2:] in (".a", ".b"))
        joint, side = (rest, "") if own else (rest[:-2], rest[-1:])
        change = np.zeros(3)
        i = AXES.index(axis)
        before = mechanism.joint(joint)
        start = (before.a if side == "a" else before.b).point[i] if what == "at" else 0.0
        change[i] = value - start
        joints[joint] = _moved(mechanism, joints[joint], side, what, change)
    return replace(mechanism, joints=tuple(joints.values()))


def _moved(mechanism: Mechanism, joint: Joint, side: str, what: str, change: Array) -> Joint:
    if side:
        return replace(joint, **{side: _end(getattr(joint, side), what, change)})
    return replace(
        joint,
        a=_end(joint.a, what, _between(mechanism, joint) @ change),
        b=_end(joint.b, what, change),
    )


def _between(mechanism: Mechanism, joint: Joint) -> Array:
    """Return the rotation from link b's frame to link a's at which both sides of a joint coincide."""
    if KINDS[joint.kind].aligned:
        return joint.a.frame @ joint.b.frame.T
    poses = {GROUND: IDENTITY, **guessed_poses(mechanism)}
    return poses[joint.a.link].rotation.T @ poses[joint.b.link].rotation


def _end(end: End, what: str, change: Array) -> End:
    if what == "at":
        return replace(end, point=_vector(np.asarray(end.point) + change))
    frame = turned_by(end.frame[None], change[None])[0]
    return End(end.link, end.point, _vector(frame[:, 2]), _vector(frame[:, 0]))


def _vector(values: Array) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
