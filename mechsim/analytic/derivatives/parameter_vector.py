"""The numbers of a mechanism or of forces as a vector, and the same with other numbers, also complex ones."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Any

import numpy as np

from mechsim.model.forces import Forces, Friction, JointSpring, Load, Spring
from mechsim.model.joints import Coupling, End, Joint
from mechsim.model.links import Inertia, Link
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# fields with numbers on which motions and forces depend; load profiles over angle or time have none
NUMBER_FIELDS: Mapping[type, tuple[str, ...]] = {
    Joint: ("a", "b", "cross_angle"),
    End: ("point", "axis", "reference"),
    Coupling: ("left", "right", "coefficients", "zeros", "pressure_angle"),
    Link: ("inertia",),
    Inertia: ("mass", "centre", "moments"),
    Forces: ("gravity", "flywheel", "friction", "springs", "joint_springs", "loads"),
    Friction: ("viscous", "coulomb", "viscous_turn", "coulomb_turn"),
    Spring: ("a", "b", "stiffness", "rest", "damping"),
    JointSpring: ("stiffness", "rest"),
    Load: ("location",),
}


@dataclass(frozen=True)
class GivenMechanism(Mechanism):
    """A mechanism with given numbers and characteristic length, without checks: numbers can be complex.

    All couplings, with those of gears and screws, are `couplings`.
    """

    given_length: float = 1.0

    def __post_init__(self) -> None: ...

    @property
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
    if kind is None:
        return description
    copy: Any = object.__new__(_unchecked(kind))
    for name in (field.name for field in fields(kind)):
        value = getattr(description, name)
        object.__setattr__(copy, name, _renumbered(value, number) if name in NUMBER_FIELDS[kind] else value)
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
