"""The numbers of a mechanism as a vector, and the mechanism with other numbers, complex ones included."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields

import numpy as np

from mechsim.model.forces import Forces, Friction, JointSpring, Load, Location, Spring
from mechsim.model.joints import Coupling, End, Joint
from mechsim.model.links import Inertia, Link
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array


class Unchecked:
    """Base of descriptions without the checks of their class, because their numbers can be complex."""

    def __post_init__(self) -> None: ...


@dataclass(frozen=True)
class GivenEnd(Unchecked, End):
    """A joint end with a given frame, (3, 3); axis and reference are columns of it."""

    columns: Array = field(default_factory=lambda: np.eye(3))
    has_reference: bool = field(init=False, default=True, compare=False, repr=False)

    @property
    def frame(self) -> Array:
        """The joint's frame in the link's, (3, 3)."""
        return self.columns


@dataclass(frozen=True)
class GivenJoint(Unchecked, Joint):
    """A joint with given numbers."""


@dataclass(frozen=True)
class GivenCoupling(Unchecked, Coupling):
    """A coupling with given numbers."""


@dataclass(frozen=True)
class GivenInertia(Unchecked, Inertia):
    """An inertia with given numbers."""


@dataclass(frozen=True)
class GivenMechanism(Unchecked, Mechanism):
    """A mechanism with given numbers, characteristic length and couplings."""

    given_length: float = 1.0
    given_laws: tuple[Coupling, ...] = ()

    @property
    def characteristic_length(self) -> float:
        """Its given characteristic length, in [m]."""
        return self.given_length

    @property
    def laws(self) -> tuple[Coupling, ...]:
        """All couplings, with those of gears and screws."""
        return self.given_laws


def numbers_of(mechanism: Mechanism) -> Array:
    """Return all numbers on which the motion and the forces of a mechanism depend, (k,) in SI.

    They do not include the guess and the coordinates at the guess.
    """
    rows = [np.atleast_1d(np.asarray(values, dtype=np.float64)).ravel() for values in _numbers(mechanism)]
    return np.concatenate(rows)


def _numbers(mechanism: Mechanism) -> Iterator[object]:
    for joint in mechanism.joints:
        for end in (joint.a, joint.b):
            yield from (end.point, end.frame)
        yield joint.cross_angle
    for law in mechanism.laws:
        yield from (law.coefficients, law.zeros, [*law.left_terms.values()], [*law.right_terms.values()])
        yield law.pressure_angle or 0.0
    yield [*mechanism.locked.values()]
    for _, local in mechanism.points.values():
        yield local
    for link in mechanism.links:
        if link.inertia is not None:
            yield from (link.inertia.mass, link.inertia.centre, link.inertia.moments)


class VectorReader:
    """Reads numbers from a vector in order."""

    def __init__(self, row: Array):
        self.row, self.next = row, 0

    def numbers(self, count: int) -> Array:
        """Return the next numbers."""
        self.next += count
        return self.row[self.next - count : self.next]

    def tuple(self, count: int) -> tuple[float, ...]:
        """Return the next numbers as a tuple."""
        return tuple(self.numbers(count).tolist())

    def terms(self, table: Mapping[str, float]) -> dict[str, float]:
        """Return the next numbers for the names of a table."""
        return dict(zip(table, self.numbers(len(table)).tolist(), strict=True))


def with_numbers(mechanism: Mechanism, numbers: Array) -> GivenMechanism:
    """Return a mechanism with other numbers, (k,) in the order of `numbers_of`, complex or real.

    Its characteristic length stays that of the original.
    """
    take = VectorReader(numbers)
    joints = tuple(_joint(joint, take) for joint in mechanism.joints)
    laws = tuple(_coupling(law, take) for law in mechanism.laws)
    holds = take.terms(mechanism.locked)
    points = {name: (link, take.tuple(3)) for name, (link, _) in mechanism.points.items()}
    links = tuple(_link(link, take) for link in mechanism.links)
    own = {item.name: getattr(mechanism, item.name) for item in fields(mechanism)}
    own |= {
        "joints": joints,
        "links": links,
        "points": points,
        "locked": holds,
        "gears": (),
        "couplings": laws,
    }
    own |= {"given_length": mechanism.characteristic_length, "given_laws": laws}
    return GivenMechanism(**own)


def _end(end: End, take: VectorReader) -> GivenEnd:
    point, frame = take.tuple(3), take.numbers(9).reshape(3, 3)
    return GivenEnd(end.link, three(point), three(frame[:, 2]), three(frame[:, 0]), frame)


def _joint(joint: Joint, take: VectorReader) -> GivenJoint:
    a, b = _end(joint.a, take), _end(joint.b, take)
    return GivenJoint(joint.name, joint.kind, a, b, take.numbers(1)[0], joint.lead)


def _coupling(law: Coupling, take: VectorReader) -> GivenCoupling:
    coefficients, zeros = take.tuple(len(law.coefficients)), take.tuple(2)
    left_terms, right_terms = take.terms(law.left_terms), take.terms(law.right_terms)
    teeth = take.numbers(1)[0]
    teeth = None if law.pressure_angle is None else teeth
    return GivenCoupling(
        law.name, left_terms, right_terms, coefficients, (zeros[0], zeros[1]), law.turns, teeth
    )


def _link(link: Link, take: VectorReader) -> Link:
    if link.inertia is None:
        return link
    mass, centre, moments = take.numbers(1)[0], take.tuple(3), take.numbers(9).reshape(3, 3).tolist()
    a, b, c = (three(row) for row in moments)
    return Link(link.name, link.outline, GivenInertia(mass, three(centre), (a, b, c)))


def three(values: Sequence[float] | Array) -> tuple[float, float, float]:
    """Return three numbers as a tuple."""
    x, y, z = values
    return x, y, z


@dataclass(frozen=True)
class GivenFriction(Unchecked, Friction):
    """Friction with given numbers."""


@dataclass(frozen=True)
class GivenSpring(Unchecked, Spring):
    """A spring with given numbers."""


@dataclass(frozen=True)
class GivenJointSpring(Unchecked, JointSpring):
    """A joint spring with given numbers."""


@dataclass(frozen=True)
class GivenForces(Unchecked, Forces):
    """Forces with given numbers."""


def force_numbers(forces: Forces) -> Array:
    """Return the numbers of forces, (k,) in SI, without load profiles over angle or time."""
    return np.concatenate(
        [np.atleast_1d(np.asarray(values, dtype=np.float64)) for values in _force_values(forces)]
    )


def _force_values(forces: Forces) -> Iterator[object]:
    yield from (forces.gravity, forces.flywheel)
    for friction in forces.friction:
        yield (friction.viscous, friction.coulomb, friction.viscous_turn, friction.coulomb_turn)
    for spring in forces.springs:
        yield (spring.stiffness, spring.rest, spring.damping)
        yield from (_local(spring.a), _local(spring.b))
    for joint_spring in forces.joint_springs:
        yield (joint_spring.stiffness, joint_spring.rest)
    for load in forces.loads:
        yield _local(load.location)


def _local(location: Location) -> tuple[float, ...]:
    """Return the numbers of a location; those of a tracked point belong to the mechanism."""
    return () if isinstance(location, str) else location[1]


def with_force_numbers(forces: Forces, row: Array) -> Forces:
    """Return forces with other numbers, (k,) in the order of `force_numbers`."""
    take = VectorReader(row)

    def located(location: Location) -> Location:
        return location if isinstance(location, str) else (location[0], three(take.numbers(3)))

    def numbered(spring: Spring) -> Spring:
        numbers = take.tuple(3)
        return GivenSpring(located(spring.a), located(spring.b), *numbers)

    gravity, flywheel = three(take.numbers(3)), take.numbers(1)[0]
    friction = tuple(GivenFriction(row.joint, *take.tuple(4)) for row in forces.friction)
    springs = tuple(numbered(spring) for spring in forces.springs)
    joint_springs = tuple(GivenJointSpring(spring.joint, *take.tuple(2)) for spring in forces.joint_springs)
    loads = tuple(Load(located(load.location), load.force) for load in forces.loads)
    return GivenForces(
        gravity=gravity,
        friction=friction,
        springs=springs,
        joint_springs=joint_springs,
        loads=loads,
        couples=forces.couples,
        crank_torque=forces.crank_torque,
        flywheel=flywheel,
        motor=forces.motor,
    )
