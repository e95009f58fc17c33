"""Joints, points and axes of two links that meet as its kind says, and couplings of their coordinates."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property

import numpy as np

from mechsim.errors import InputError
from mechsim.model.joint_kinds import KINDS, KindName, coordinates
from mechsim.model.links import EX, EY, EZ, FARTHEST, ORIGIN, Pose, Vector, vector
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import number, numbers, require

# the highest degree, that of MJCF's joint equality
MAX_DEGREE = 4

Terms = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class Gear:
    """Coordinate of joint `driven` = ratio * coordinate of joint `driver` + phase.

    Attributes:
        driver: name of a revolute joint.
        driven: name of another revolute joint.
        ratio: turns of `driven` per turn of `driver`; negative for outside meshing.
        phase: angle of `driven` where `driver` is at zero, in [rad].
        pressure_angle: of the teeth, in [rad]; 0 leaves the tooth force tangential.
    """

    driver: str
    driven: str
    ratio: float
    phase: float = 0.0
    pressure_angle: float = 0.0

    @property
    def name(self) -> str:
        """What it is called."""
        return f"{self.driver}-{self.driven}"


@dataclass(frozen=True, slots=True)
class Coupling:
    """left - zeros[0] = p(right - zeros[1]), where left and right are weighted sums of coordinates.

    Attributes:
        name: of the coupling.
        left: name of a coordinate, or coordinate -> weight.
        right: likewise; empty where the left side is held.
        coefficients: of the polynomial p from the constant up, in SI, five at the most.
        zeros: from which either side is counted, in the coordinates' own units.
        turns: whether whole turns between both sides do not count, as of gears.
        pressure_angle: of the teeth of a gear pair or a rack and pinion, in [rad]; 0 leaves the tooth force
            tangential. None for what has no teeth: an ideal transmission.
    """

    name: str
    left: str | Terms
    right: str | Terms
    coefficients: tuple[float, ...]
    zeros: tuple[float, float] = (0.0, 0.0)
    turns: bool = False
    pressure_angle: float | None = None

    def __post_init__(self) -> None:
        if not 1 <= len(self.coefficients) <= MAX_DEGREE + 1:
            raise InputError(
                f"coupling {self.name!r} has {len(self.coefficients)} coefficients; "
                f"give 1 to {MAX_DEGREE + 1}, from the constant up"
            )
        numbers = [*self.coefficients, *self.zeros, *self.left_terms.values(), *self.right_terms.values()]
        if not np.isfinite([number(value) for value in numbers]).all():
            raise InputError(f"coupling {self.name!r} holds {numbers}; give finite numbers")
        if not self.left_terms:
            raise InputError(f"coupling {self.name!r} couples nothing; name a coordinate on its left side")

    @property
    def left_terms(self) -> Terms:
        """Coordinate -> weight on the left side."""
        return {self.left: 1.0} if isinstance(self.left, str) else self.left

    @property
    def right_terms(self) -> Terms:
        """Coordinate -> weight on the right side."""
        return {self.right: 1.0} if isinstance(self.right, str) else self.right

    @property
    def coordinates(self) -> tuple[str, ...]:
        """All coordinates it names."""
        return (*self.left_terms, *self.right_terms)

    @property
    def ratio(self) -> float:
        """The coefficient of the first power: of gears, the ratio."""
        return self.coefficients[1] if len(self.coefficients) > 1 else 0.0

    @property
    def label(self) -> str:
        """Both sides in words."""
        return f"{'+'.join(self.right_terms) or 'nothing'}-{'+'.join(self.left_terms)}"

    def polynomial(self, right: Array) -> tuple[Array, Array, Array]:
        """Return p, p' and p'' at values of the right side."""
        p = np.polynomial.Polynomial(self.coefficients)
        offset = right - self.zeros[1]
        return p(offset), p.deriv(1)(offset), p.deriv(2)(offset)


# axes whose sum has a smaller square are opposed, to rounding
OPPOSED = 1e-14
# largest angle in [rad] between a guess and the orientation that it selects
MAX_GUESS_ERROR = np.pi / 4


def smallest_rotation_reference(own: Array, axis: Array, reference: Array) -> Array:
    """Return the reference direction that the smallest rotation of an axis onto another makes parallel, (3,).

    Antiparallel axes are rotated about z, or about the other reference where z is not across.
    """
    across, between = np.cross(own, axis), own + axis
    if (nearness := float(between @ between)) > OPPOSED:
        back = np.cross(across, reference)
        return reference - back + 2.0 * np.cross(across, back) / nearness
    about = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < OPPOSED else reference
    return 2.0 * about * (about @ reference) - reference


def guessed_frame(side: Array, frames: Sequence[Array], rotation: Array) -> tuple[int, float]:
    """Return which of several joint frames of side b is meant by a guess, and how far off in [rad] that is.

    Args:
        side: the joint's frame on side a, (3, 3), with the axis as its last column.
        frames: those of side b.
        rotation: rotation of link b seen from link a, as guessed.

    Where the guess lays the axes more against than along each other it says nothing: the first is taken.
    """
    own = rotation @ frames[0][:, 2]
    if not own @ side[:, 2] > 0.0:
        return 0, 0.0
    target = smallest_rotation_reference(own, side[:, 2], side[:, 0])
    cosines = [float((rotation @ frame[:, 0]) @ target) for frame in frames]
    best = int(np.argmax(cosines))
    return best, float(np.arccos(np.clip(cosines[best], -1.0, 1.0)))


# lengths and cosines of unit vectors across each other are off by less
ROUNDED = 1e-14


@dataclass(frozen=True, slots=True)
class End:
    """One side of a joint, in the frame of the link it belongs to.

    Attributes:
        link: name of the link.
        point: where the joint is, in [m].
        axis: direction of the joint's axis; made a unit vector.
        reference: direction across the axis from which the joint's angle is counted; made a unit vector
            across the axis. None takes the frame's x axis, or y where x lies along the axis.
        has_reference: whether a reference was given.
    """

    link: str
    point: Vector = ORIGIN
    axis: Vector = EZ
    reference: Vector | None = None
    has_reference: bool = field(init=False, default=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "has_reference", self.reference is not None)
        point, axis = _finite(self, "point", self.point), _finite(self, "axis", self.axis)
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise InputError(f"axis of a joint on link {self.link!r} is the zero vector; give a direction")
        reference_given = self.reference
        if reference_given is None:
            reference_given = EX if abs(axis[0]) < 0.9 * length else EY
        reference = _finite(self, "reference", reference_given)
        # those of another End stay what they are to the last bit
        if self.reference is None or not _unit_and_across(axis, reference):
            axis = axis / length
            reference = reference - axis * (axis @ reference)
            length = float(np.linalg.norm(reference))
            if not length > 1e-9:
                raise InputError(
                    f"reference {reference_given} of a joint on link {self.link!r} lies along its axis; "
                    "give a direction across the axis"
                )
            reference = reference / length
        object.__setattr__(self, "point", tuple(point.tolist()))
        object.__setattr__(self, "axis", tuple(axis.tolist()))
        object.__setattr__(self, "reference", tuple(reference.tolist()))

    @property
    def frame(self) -> Array:
        """The joint's frame in the link's, read-only (3, 3): columns reference, axis x reference, axis."""
        assert self.reference is not None
        return _frame(self.axis, self.reference)

    @property
    def frame_columns(self) -> tuple[Vector, Vector, Vector]:
        """The columns of `frame`."""
        assert self.reference is not None
        return _columns(self.axis, self.reference)


@cache
def _frame(axis: Vector, reference: Vector) -> Array:
    frame = np.column_stack([reference, np.cross(axis, reference), axis])
    frame.flags.writeable = False
    return frame


@cache
def _columns(axis: Vector, reference: Vector) -> tuple[Vector, Vector, Vector]:
    first, second, third = (vector(column) for column in _frame(axis, reference).T)
    return first, second, third


@dataclass(frozen=True)
class Joint:
    """Two links meet: point on point, axis on axis, as the kind says.

    - revolute: points and axes coincide. Coordinate: angle from a's reference to b's about the axis.
    - prismatic: axes coincide, marks stay parallel. Coordinate: displacement of b's point along the axis.
      Where neither side has a reference, the links are turned by the least that lays axis on axis; in a
      mechanism whose guess is nearer to that, as if each side had the reference it has by itself.
    - cylindrical: axes coincide. Coordinates: displacement, then angle.
    - screw: as cylindrical, and the displacement is `lead` times the turns.
    - universal: points coincide, axes cross at `cross_angle`. Coordinates: angle about a's axis,
      angle about b's; both zero where b's axis lies from a's axis towards a's reference.
    - spherical: points coincide. No coordinate.
    - planar: axes stay parallel and b's point in the plane across a's axis. Coordinates: displacements
      along a's reference and across it, then angle.
    - fixed: points coincide, axes and marks too, which may be left out likewise. No coordinate.
    - floating: nothing is held. Coordinates: the place of b's point in a's frame.

    Attributes:
        name: unique in the mechanism.
        kind: one of `model.joint_kinds.KINDS`, as above.
        a: the side nearer the frame.
        b: the other side.
        cross_angle: of a universal joint, in [rad].
        lead: of a screw, displacement a turn in [m].
        without_reference: whether no reference says how a slide turns its links.
    """

    name: str
    kind: KindName
    a: End
    b: End
    cross_angle: float = np.pi / 2
    lead: float = 0.0
    without_reference: bool = field(init=False, default=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        if str(self.kind) not in KINDS:
            raise InputError(f"joint {self.name!r} is of kind {self.kind!r}; known are {', '.join(KINDS)}")
        for end in (self.a, self.b):
            require(f"a side of joint {self.name!r}", end, End)
        if self.a.link == self.b.link:
            raise InputError(f"joint {self.name!r} joins link {self.a.link!r} to itself; name two links")
        if not 0.0 < number(self.cross_angle) < np.pi:
            raise InputError(
                f"cross angle of joint {self.name!r} is {self.cross_angle} rad; give one between 0 and pi"
            )
        if not KINDS[self.kind].crossed and self.cross_angle != np.pi / 2:
            raise InputError(
                f"cross angle of {self.kind} joint {self.name!r} is {self.cross_angle} rad; only the axes of "
                "a universal joint cross: take it out"
            )
        if not abs(number(self.lead)) < np.inf or KINDS[self.kind].helical != (self.lead != 0.0):
            raise InputError(
                f"lead of {self.kind} joint {self.name!r} is {self.lead} m; "
                "give a screw its displacement a turn, and no other joint any"
            )
        if 0 in KINDS[self.kind].aligned_columns and not (self.a.has_reference or self.b.has_reference):
            side = self.a.frame
            reference = smallest_rotation_reference(np.array(self.b.axis), side[:, 2], side[:, 0])
            if np.abs(reference - np.array(self.b.reference)).max() > ROUNDED:
                object.__setattr__(self, "b", replace(self.b, reference=vector(reference)))
                object.__setattr__(self, "without_reference", True)

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Names of its coordinates: the joint's own where it has one, else NAME.way, NAME.turn, NAME.1 ..."""
        return tuple(self.name + ending for ending in KINDS[self.kind].suffixes)


def joint_coordinate(joint: Joint, a: Pose, b: Pose) -> Array:
    """Return the coordinates of a joint between two posed links, (..., k).

    k is 1 for revolute and prismatic joints, 2 for cylindrical and universal ones, 0 for spherical
    ones; angles in (-pi, pi] rad, displacements in [m].
    """
    gap = b.point(joint.b.point) - a.point(joint.a.point)
    frame_a, frame_b = a.rotation @ joint.a.frame, b.rotation @ joint.b.frame  # (..., 3, 3)
    return coordinates(KINDS[joint.kind], gap, frame_a, frame_b, joint.cross_angle)


def _unit_and_across(axis: Array, reference: Array) -> bool:
    """Whether axis and reference are unit vectors across each other already, to rounding."""
    both = np.column_stack([axis, reference])
    return bool(np.abs(both.T @ both - np.eye(2)).max() < ROUNDED)


def _finite(end: End, what: str, value: Vector) -> Array:
    vector = numbers(value)
    if vector.shape != (3,) or not (np.abs(vector) < FARTHEST).all():
        raise InputError(
            f"{what} {value} of a joint on link {end.link!r} is not three finite numbers below {FARTHEST:g}"
        )
    return vector
