"""Gear, bevel and rack pairs: pitch point and direction of the tooth force.

Two wheels on the same carrier link roll on each other along the pitch line, the axis of their relative
rotation. Parallel shafts have a parallel pitch line, the crossing shafts of a bevel pair one through their
intersection, a rack and its pinion one along the pinion's shaft.
"""

from dataclasses import dataclass

import numpy as np

from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import Coupling, End, Joint
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import ROUNDING, Array


@dataclass(frozen=True, slots=True)
class ToothedLink:
    """A wheel or rack relative to its carrier.

    Attributes:
        joint: joint between carrier and wheel or rack.
        link: the wheel or rack.
        end: the joint's side on the carrier.
        sign: +1 if the wheel is the joint's link b, -1 if it is link a.
    """

    joint: Joint
    link: str
    end: End
    sign: float

    @property
    def turns(self) -> bool:
        """Whether it is a wheel, not a rack."""
        return KINDS[self.joint.kind].hinge

    @property
    def axis(self) -> Array:
        """Axis of its joint, in the carrier's frame, (3,)."""
        return self.end.frame[:, 2]

    @property
    def twist(self) -> tuple[Array, Array]:
        """Angular velocity, and velocity of its point at the carrier's origin, per unit rate."""
        along = self.sign * self.axis
        if not self.turns:
            return np.zeros(3), along
        return along, np.cross(self.end.point, along)

    def velocity(self, point: Array) -> Array:
        """Return the velocity of the wheel or rack at a point, per unit rate of the coordinate, (3,)."""
        spin, origin = self.twist
        return origin + np.cross(spin, point)

    def inward(self, point: Array) -> Array:
        """Return the vector from a point to the nearest point of its axis, (3,)."""
        gap = np.asarray(self.end.point) - point
        return gap - self.axis * (self.axis @ gap)


@dataclass(frozen=True, slots=True)
class Mesh:
    """The tooth contact of two links, in the frame of the link that carries both.

    Attributes:
        driven: the wheel or rack of the coupling's driven coordinate.
        driver: the other wheel or rack.
        carrier: the link that carries both.
        point: the pitch point, (3,) in [m].
        tangential: force on `driven` per unit of generalised force on its coordinate, (3,).
        separating: additional force on `driven` due to the pressure angle, per unit magnitude of that force,
            (3,).
    """

    driven: ToothedLink
    driver: ToothedLink
    carrier: str
    point: Array
    tangential: Array
    separating: Array


def meshes_of(mechanism: Mechanism) -> dict[str, Mesh]:
    """Return coupling name (as in `Mechanism.named_laws`) -> mesh, for couplings that have one."""
    meshes = {name: mesh_of(mechanism, law) for name, law in mechanism.named_laws.items()}
    return {name: mesh for name, mesh in meshes.items() if mesh is not None}


def threads_of(mechanism: Mechanism) -> dict[str, Joint]:
    """Return coupling name -> screw joint, for the couplings of screws."""
    screws = [joint for joint in mechanism.joints if KINDS[joint.kind].helical]
    return {
        name: joint
        for name, law in mechanism.named_laws.items()
        for joint in screws
        if {*law.coordinates} == {*joint.coordinates}
    }


def mesh_of(mechanism: Mechanism, law: Coupling) -> Mesh | None:
    """Return the mesh of a coupling; None for an ideal transmission, which has no pitch point.

    The pitch point lies on the pitch line, halfway between the planes perpendicular to the shafts through the
    joint points; a joint point at the intersection of the shafts is ignored.
    """
    pair = _toothed(mechanism, law)
    if pair is None:
        return None
    driven, driver = pair
    weights = [next(iter(terms.values())) for terms in (law.left_terms, law.right_terms)]
    rate = law.ratio * weights[1] / weights[0]
    (spin2, origin2), (spin1, origin1) = driven.twist, driver.twist
    line = _pitch_line(rate * spin2 - spin1, rate * origin2 - origin1, mechanism.characteristic_length)
    point = None if line is None else _pitch_point(pair, *line, mechanism.characteristic_length)
    if line is None or point is None:
        return None
    velocity = driven.velocity(point)
    tangential = weights[0] * velocity / (velocity @ velocity)
    outward = np.cross(line[1], tangential)
    small = min((wheel for wheel in pair if wheel.turns), key=lambda wheel: _length(wheel.velocity(point)))
    inwards = np.real(outward @ small.inward(point)) > 0.0
    separating = outward * np.tan(law.pressure_angle or 0.0) * (1.0 if inwards == (small is driven) else -1.0)
    return Mesh(driven, driver, driven.end.link, point, tangential, separating)


def _toothed(mechanism: Mechanism, law: Coupling) -> tuple[ToothedLink, ToothedLink] | None:
    """Return driven and driver of a coupling with teeth whose joints share a link; else None."""
    sides = len(law.left_terms), len(law.right_terms), len(law.coefficients)
    if law.pressure_angle is None or sides != (1, 1, 2):
        return None
    joints = {joint.name: joint for joint in mechanism.joints if KINDS[joint.kind].single}
    driven, driver = (joints.get(name) for name in law.coordinates)
    if driven is None or driver is None or driven is driver:
        return None
    shared = {*driven.links} & {*driver.links}
    if len(shared) != 1:
        return None
    carrier = shared.pop()
    return _wheel(driven, carrier), _wheel(driver, carrier)


def _wheel(joint: Joint, carrier: str) -> ToothedLink:
    if joint.a.link == carrier:
        return ToothedLink(joint, joint.b.link, joint.a, 1.0)
    return ToothedLink(joint, joint.a.link, joint.b, -1.0)


def _pitch_line(spin: Array, origin: Array, length: float) -> tuple[Array, Array] | None:
    """Return a point and the direction of the axis of a twist without pitch; None if it has a pitch."""
    square = spin @ spin
    if not _length(spin) > ROUNDING:
        return None
    if not abs(np.real(spin @ origin)) <= ROUNDING * length * np.real(square):
        return None
    return np.cross(spin, origin) / square, spin / np.sqrt(square)


def _pitch_point(
    pair: tuple[ToothedLink, ToothedLink], start: Array, along: Array, length: float
) -> Array | None:
    """Return the pitch point on a pitch line; None if a wheel would have no radius."""

    def rolls(point: Array) -> bool:
        return all(
            _length(wheel.velocity(point)) > (ROUNDING * length if wheel.turns else 0.0) for wheel in pair
        )

    points: list[Array] = []
    for wheel in pair:
        cosine = wheel.axis @ along
        if wheel.turns and abs(np.real(cosine)) > ROUNDING:
            points.append(start + along * (wheel.axis @ (np.asarray(wheel.end.point) - start) / cosine))
    points = [point for point in points if rolls(point)]
    if not points:
        return None
    point = np.sum(points, 0) / len(points)
    return point if rolls(point) else None


def _length(vector: Array) -> float:
    """Return the length of a vector, which may have complex steps."""
    return float(np.linalg.norm(np.real(vector)))
