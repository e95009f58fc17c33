"""Joints between two links, and couplings of their coordinates."""

from __future__ import annotations

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from mechsim.errors import InputError, several
from mechsim.mechanism.joint_kinds import ALIASES, KINDS, KindName, coordinates, kinds_that
from mechsim.mechanism.links import EX, EY, EZ, MAX_COORDINATE, ORIGIN, VIRTUAL_PREFIX, Pose, Vector, vector
from mechsim.numerics.arrays import Array, at_least_zero, number, numbers, polynomial, require

if TYPE_CHECKING:
    from mechsim.mechanism.curves import CouplingFunction

# highest degree of a coupling polynomial, the limit of MJCF's joint equality
MAX_DEGREE = 4
# largest ratio of a coupling: in one revolution of the driver, the rounding of the driven angle is 1e-9 rad
MAX_RATIO = 1e6

Terms = Mapping[str, float]
# of a joint: points (..., 3) and frames (..., 3, 3) of its sides a and b, in the frames of their links
Sides = tuple[Array, Array, Array, Array]


@dataclass(frozen=True, slots=True)
class Gear:
    """Coordinate of joint `driven` = ratio * coordinate of joint `driver` + phase.

    Attributes:
        driver: name of a revolute joint.
        driven: name of another revolute joint.
        ratio: revolutions of `driven` per revolution of `driver`; negative for external meshing.
        phase: angle of `driven` at zero angle of `driver`, in [rad].
        pressure_angle: of the teeth, in [rad]; at 0 the tooth force is tangential.
    """

    driver: str
    driven: str
    ratio: float
    phase: float = 0.0
    pressure_angle: float = 0.0

    @property
    def name(self) -> str:
        """Name of the pair, DRIVER-DRIVEN."""
        return f"{self.driver}-{self.driven}"

    @property
    def coupling(self) -> Coupling:
        """The same law as a coupling."""
        terms, teeth = (self.phase, self.ratio), self.pressure_angle
        return Coupling(self.name, self.driven, self.driver, terms, turns=True, pressure_angle=teeth)


@dataclass(frozen=True, slots=True)
class Belt:
    """Pulleys of a belt or chain, in [m].

    Attributes:
        radii: of driver and driven pulley.
        length: of the belt, if stated; else 0.
        tensioner: point of the shaft of a pulley that presses on the outside, on side a of the joints; or
            None.
        tensioner_radius: of this pulley.
    """

    radii: tuple[float, float]
    length: float = 0.0
    tensioner: Vector | None = None
    tensioner_radius: float = 0.0


@dataclass(frozen=True, slots=True)
class Coupling:
    """left - zeros[0] = p(right - zeros[1]), where left and right are weighted sums of coordinates.

    Attributes:
        name: name of the coupling.
        left: name of a coordinate, or coordinate -> weight.
        right: name or weights, as `left`; empty if the left side is constant.
        coefficients: of the polynomial p in SI, constant first; five at most.
        zeros: zero positions of the left and the right side, in the units of the coordinates.
        turns: whether the sides may differ by whole revolutions, as in gears.
        pressure_angle: of the teeth of a gear pair or a rack and pinion, in [rad]; at 0 the tooth force is
            tangential. None for an ideal transmission without teeth.
        function: takes the place of p; the coefficients are then empty.
        repeats: whether the function repeats after a revolution of the right side, as that of a cam.
        belt: pulleys of a belt or chain, for its length and its picture.
        rope: whether it is a rope under tension, the left side its path and the right one empty.
        backlash: play between its flanks, in the unit of the left side; in a prescribed motion the left side
            is in the middle.
    """

    JSON: ClassVar[tuple[str, ...]] = ("name", "driven=left_terms", "driver=right_terms", "coefficients")

    name: str
    left: str | Terms
    right: str | Terms
    coefficients: tuple[float, ...]
    zeros: tuple[float, float] = (0.0, 0.0)
    turns: bool = False
    pressure_angle: float | None = None
    function: CouplingFunction | None = None
    rope: bool = False
    repeats: bool = False
    belt: Belt | None = None
    backlash: float = 0.0

    def __post_init__(self) -> None:
        counts = (1, MAX_DEGREE + 1) if self.function is None else (0, 0)
        if not counts[0] <= len(self.coefficients) <= counts[1]:
            raise InputError(
                f"coupling {self.name!r} has {several(len(self.coefficients), 'coefficient')}; "
                f"give {counts[0]} to {counts[1]}, constant first"
            )
        at_least_zero(f"backlash of coupling {self.name!r}", self.backlash)
        numbers = [*self.coefficients, *self.zeros, *self.left_terms.values(), *self.right_terms.values()]
        if not np.isfinite([number(value) for value in numbers]).all():
            raise InputError(f"coupling {self.name!r} has coefficients {numbers}; give finite numbers")
        ratio = max(self.ratio, *self.left_terms.values(), *self.right_terms.values(), key=abs)
        if abs(ratio) > MAX_RATIO:
            raise InputError(f"coupling {self.name!r} has the ratio {ratio:g}; give {MAX_RATIO:g} at most")
        if not self.left_terms:
            raise InputError(f"coupling {self.name!r} couples no coordinate; name one on its left side")

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
        """Names of all its coordinates."""
        return (*self.left_terms, *self.right_terms)

    @property
    def ratio(self) -> float:
        """The linear coefficient, the ratio of gears."""
        return self.coefficients[1] if len(self.coefficients) > 1 else 0.0

    @property
    def label(self) -> str:
        """Names of both sides, for messages; the own name of a rope, or of a law of virtual bodies."""
        if self.rope or any(n.startswith(VIRTUAL_PREFIX) for n in (*self.left_terms, *self.right_terms)):
            return self.name
        return f"{'+'.join(self.right_terms) or 'nothing'}-{'+'.join(self.left_terms)}"

    def polynomial(self, right: Array) -> tuple[Array, Array, Array]:
        """Return p, or the function, and its first two derivatives at values of the right side."""
        offset = right - self.zeros[1]
        return self.function(offset) if self.function else polynomial(self.coefficients, offset)


# squared length of the sum of two unit vectors below which they count as antiparallel (rounding)
ANTIPARALLEL = 1e-14
# largest angle in [rad] between a guess and the orientation that it selects
MAX_GUESS_ERROR = np.pi / 4


def smallest_rotation_reference(own: Array, axis: Array, reference: Array) -> Array:
    """Return the reference direction made parallel by the smallest rotation between two axes, (3,).

    Antiparallel axes are rotated about z, or about the other reference if z is not perpendicular to them.
    """
    across, between = np.cross(own, axis), own + axis
    # without a cast: axes may have complex steps
    if np.real(squared := between @ between) > ANTIPARALLEL:
        back = np.cross(across, reference)
        return reference - back + 2.0 * np.cross(across, back) / squared
    about = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < ANTIPARALLEL else reference
    return 2.0 * about * (about @ reference) - reference


def guessed_frame(side: Array, frames: Sequence[Array], rotation: Array) -> tuple[int, float]:
    """Return the index of the joint frame of side b that is nearest to a guess, and its error in [rad].

    Args:
        side: joint frame on side a, (3, 3), with the axis as its last column.
        frames: candidates for the joint frame of side b.
        rotation: guessed rotation of link b relative to link a.

    If the guess has an angle above 90 degrees between the axes, it selects no frame, and the first is
    returned.
    """
    own = rotation @ frames[0][:, 2]
    if not own @ side[:, 2] > 0.0:
        return 0, 0.0
    target = smallest_rotation_reference(own, side[:, 2], side[:, 0])
    cosines = [float((rotation @ frame[:, 0]) @ target) for frame in frames]
    best = int(np.argmax(cosines))
    return best, float(np.arccos(np.clip(cosines[best], -1.0, 1.0)))


# error of lengths and cosines of unit vectors below which they count as orthonormal (rounding)
ROUNDING = 1e-14


@dataclass(frozen=True, slots=True)
class End:
    """One side of a joint, in the frame of its link.

    Attributes:
        link: name of the link.
        point: position of the joint, in [m].
        axis: direction of the joint's axis, normalised.
        reference: direction of zero joint angle, made perpendicular to the axis and normalised. The default
            is the frame's x axis, or y if x is nearly parallel to the axis.
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
        # normalised vectors, such as those of another End, keep every bit
        both = np.column_stack([axis, reference])
        if self.reference is None or not np.abs(both.T @ both - np.eye(2)).max() < ROUNDING:
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
        """Joint frame in the link's frame, read-only (3, 3): columns reference, axis x reference, axis."""
        assert self.reference is not None
        return _frame(self.axis, self.reference)


@cache
def _frame(axis: Vector, reference: Vector) -> Array:
    frame = np.column_stack([reference, np.cross(axis, reference), axis])
    frame.flags.writeable = False
    return frame


@dataclass(frozen=True)
class Joint:
    """A joint between two links.

    - revolute: points and axes coincide. Coordinate: angle from a's reference to b's about the axis.
    - prismatic: axes coincide, references stay parallel. Coordinate: displacement of b's point along the
      axis. Without any reference, the smallest rotation that aligns the axes gives the orientation; if the
      guess of the mechanism is nearer to the default references of both sides, these are used.
    - cylindrical: axes coincide. Coordinates: displacement, then angle.
    - screw: as cylindrical, with a displacement of `lead` per revolution.
    - universal: points coincide, axes cross at `cross_angle`. Coordinates: angle about a's axis, angle about
      b's; both are zero if b's axis is tilted from a's axis towards a's reference.
    - spherical: points coincide. No coordinate.
    - planar: axes stay parallel, and b's point stays in the plane perpendicular to a's axis. Coordinates:
      displacements along a's reference and perpendicular to it, then angle.
    - fixed: points, axes and references coincide; references are optional as in a prismatic joint. No
      coordinate.
    - floating: no constraint. Coordinates: position of b's point in a's frame.
    - point_on_line: b's point lies on a's axis. Coordinate: its displacement along the axis.
    - point_on_plane: b's point lies in the plane perpendicular to a's axis. Coordinates: two displacements.
    - parallel_axes: axes are parallel. Coordinates: three displacements, then angle.
    - perpendicular_axes: axes have the angle `cross_angle`. Coordinates: three displacements, then angles as
      of a universal joint.
    - distance: points have the distance `length`, as by a massless rod. Coordinates: as of a floating joint.

    Attributes:
        name: unique in the mechanism.
        kind: one of `model.joint_kinds.KINDS`.
        a: the side nearer the frame.
        b: the other side.
        cross_angle: between the axes of a universal or perpendicular_axes joint, in [rad].
        lead: displacement of a screw per revolution, in [m].
        length: distance of the points of a distance joint, in [m].
        without_reference: whether neither side of a prismatic or fixed joint has a reference.
    """

    JSON: ClassVar[tuple[str, ...]] = ("name", "kind", "links")

    name: str
    kind: KindName
    a: End
    b: End
    cross_angle: float = np.pi / 2
    lead: float = 0.0
    length: float = 0.0
    without_reference: bool = field(init=False, default=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "kind", ALIASES.get(str(self.kind), self.kind))
        if str(self.kind) not in KINDS:
            raise InputError(f"joint {self.name!r} is of kind {self.kind!r}; choose from {', '.join(KINDS)}")
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
                f"a {kinds_that(lambda kind: kind.crossed)} joint cross: leave it out"
            )
        if not abs(number(self.lead)) < np.inf or KINDS[self.kind].helical != (self.lead != 0.0):
            raise InputError(
                f"lead of {self.kind} joint {self.name!r} is {self.lead} m; "
                "give a screw its displacement per revolution, and other joints none"
            )
        if not 0.0 <= number(self.length) < np.inf or KINDS[self.kind].rod != (self.length != 0.0):
            raise InputError(
                f"length of {self.kind} joint {self.name!r} is {self.length} m; give a distance joint its "
                "length above 0, and other joints none"
            )
        if 0 in KINDS[self.kind].aligned_columns and not (self.a.has_reference or self.b.has_reference):
            side = self.a.frame
            reference = smallest_rotation_reference(np.array(self.b.axis), side[:, 2], side[:, 0])
            if np.abs(reference - np.array(self.b.reference)).max() > ROUNDING:
                object.__setattr__(self, "b", replace(self.b, reference=vector(reference)))
                object.__setattr__(self, "without_reference", True)

    @property
    def sides(self) -> Sides:
        """Points (3,) and frames (3, 3) of its sides a and b."""
        return np.array(self.a.point), self.a.frame, np.array(self.b.point), self.b.frame

    @property
    def links(self) -> tuple[str, str]:
        """Names of the links that it joins, those of sides a and b."""
        return self.a.link, self.b.link

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Names of its coordinates: the joint's name if it has one, else NAME.way, NAME.turn, NAME.1 ..."""
        return tuple(self.name + ending for ending in KINDS[self.kind].suffixes)

    @property
    def unguessed(self) -> tuple[float, ...]:
        """Its coordinates if no guess states them: 0, and along a's reference the length of a rod."""
        return tuple(self.length * (i == 0) for i, _ in enumerate(self.coordinates))


def state_variable(text: str, coordinates: Container[str]) -> tuple[str, str] | None:
    """Return coordinate and letter, "q" or "v", of a state variable: J.q, J.v, or J.x, J.vx of displacements.

    None for any other text.
    """
    name, _, component = text.rpartition(".")
    if component in ("q", "v") and name in coordinates:
        return name, component
    if text in coordinates and name:
        return text, "q"
    rate = f"{name}.{component[1:]}"
    return (rate, "v") if component[:1] == "v" and rate in coordinates else None


def joint_coordinate(joint: Joint, a: Pose, b: Pose) -> Array:
    """Return the coordinates of a joint between two posed links, (..., k).

    k is 1 for revolute and prismatic joints, 2 for cylindrical and universal joints, 0 for spherical joints.
    Angles lie in (-pi, pi] rad, displacements are in [m].
    """
    gap = b.point(joint.b.point) - a.point(joint.a.point)
    frame_a, frame_b = a.rotation @ joint.a.frame, b.rotation @ joint.b.frame  # (..., 3, 3)
    return coordinates(KINDS[joint.kind], gap, frame_a, frame_b, joint.cross_angle)


def _finite(end: End, what: str, value: Vector) -> Array:
    vector = numbers(value)
    if vector.shape != (3,) or not (np.abs(vector) < MAX_COORDINATE).all():
        raise InputError(
            f"{what} {value} of a joint on link {end.link!r} is not three finite numbers "
            f"below {MAX_COORDINATE:g}"
        )
    return vector
