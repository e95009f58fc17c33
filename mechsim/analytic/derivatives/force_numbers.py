"""The numbers of what acts on a mechanism, in a row, and forces that have others, complex ones too."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mechsim.analytic.derivatives.numbers import Taker, Unchecked, three
from mechsim.model.forces import Forces, Friction, JointSpring, Load, Place, Spring
from mechsim.numerics.arrays import Array


@dataclass(frozen=True)
class GivenFriction(Unchecked, Friction):
    """Friction of given numbers."""


@dataclass(frozen=True)
class GivenSpring(Unchecked, Spring):
    """A spring of given numbers."""


@dataclass(frozen=True)
class GivenJointSpring(Unchecked, JointSpring):
    """A spring in a joint, of given numbers."""


@dataclass(frozen=True)
class GivenForces(Unchecked, Forces):
    """Forces of given numbers."""


def force_numbers(forces: Forces) -> Array:
    """Return the numbers of forces, (k,) in SI: all but the courses of loads over angle or time."""
    return np.concatenate([np.atleast_1d(np.asarray(one, dtype=np.float64)) for one in _numbers(forces)])


def _numbers(forces: Forces) -> Iterator[object]:
    yield from (forces.gravity, forces.flywheel)
    for one in forces.friction:
        yield (one.viscous, one.coulomb, one.viscous_turn, one.coulomb_turn)
    for spring in forces.springs:
        yield (spring.stiffness, spring.rest, spring.damping)
        yield from (_local(spring.a), _local(spring.b))
    for turned in forces.joint_springs:
        yield (turned.stiffness, turned.rest)
    for load in forces.loads:
        yield _local(load.place)


def _local(place: Place) -> tuple[float, ...]:
    """Return the numbers of a place: none of a tracked point, whose own are the mechanism's."""
    return () if isinstance(place, str) else place[1]


def with_force_numbers(forces: Forces, row: Array) -> Forces:
    """Return forces with other numbers, (k,) in the order of `force_numbers`."""
    take = Taker(row)

    def place(given: Place) -> Place:
        return given if isinstance(given, str) else (given[0], three(take.some(3)))

    def spring(one: Spring) -> Spring:
        numbers = take.tuple(3)
        return GivenSpring(place(one.a), place(one.b), *numbers)

    gravity, flywheel = three(take.some(3)), take.some(1)[0]
    friction = tuple(GivenFriction(one.joint, *take.tuple(4)) for one in forces.friction)
    springs = tuple(spring(one) for one in forces.springs)
    turned = tuple(GivenJointSpring(one.joint, *take.tuple(2)) for one in forces.joint_springs)
    loads = tuple(Load(place(one.place), one.force) for one in forces.loads)
    return GivenForces(
        gravity=gravity,
        friction=friction,
        springs=springs,
        joint_springs=turned,
        loads=loads,
        couples=forces.couples,
        crank_torque=forces.crank_torque,
        flywheel=flywheel,
        motor=forces.motor,
    )
