"""What a mechanism is: links in their own frames, joints that say what of one meets what of another.

A `Mechanism` is plain data. Nothing here says where a link is in space: that is solved, by the
closed forms and `closure` on one side and by MuJoCo on the other.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from mechsim.errors import InputError
from mechsim.maths.angles import TURN
from mechsim.maths.arrays import Array
from mechsim.maths.given import number, numbers, require
from mechsim.model.couplings import Coupling, Gear
from mechsim.model.display import short_repr
from mechsim.model.inertia import Inertia
from mechsim.model.joints import KINDS, KindName, coordinates
from mechsim.model.unmarked_slides import MEANT, guessed, least_turned

Vector = tuple[float, float, float]

GROUND = "ground"
# what names of links begin with that stand for no body: those between several joints of one
UNSEEN = "~"
ORIGIN: Vector = (0.0, 0.0, 0.0)
EX: Vector = (1.0, 0.0, 0.0)
EY: Vector = (0.0, 1.0, 0.0)
EZ: Vector = (0.0, 0.0, 1.0)
# what is farther away has no square that is a finite number, in [m]
FARTHEST = 1e100
# joints of a link nearer to each other than this part of all that is known of the links lie in one place
ONE_PLACE = 1e-9
# points whose distances to all others are taken at once
ROWS = 500
# lengths and cosines of unit vectors across each other are off by less
ROUNDED = 1e-14


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """Where links are: position of the origin, (..., 3) in [m], and rotation matrix, (..., 3, 3)."""

    position: Array
    rotation: Array

    def __eq__(self, other: object) -> bool:
        """Whether the other stands at the same places, to the last bit."""
        return (
            isinstance(other, Pose)
            and np.array_equal(self.position, other.position)
            and np.array_equal(self.rotation, other.rotation)
        )

    __hash__ = None  # pyright: ignore[reportAssignmentType]

    def point(self, local: Vector) -> Array:
        """Return the place of a point given in the link's frame, (..., 3) in [m]."""
        return self.position + self.rotation @ np.asarray(local)

    def at(self, index: int | slice) -> "Pose":
        """Return the pose or poses at an index of the leading axis."""
        return Pose(self.position[index], self.rotation[index])


IDENTITY = Pose(np.zeros(3), np.eye(3))


@dataclass(frozen=True, slots=True)
class Link:
    """A rigid link.

    Attributes:
        name: unique in the mechanism.
        outline: points of the link's own frame, in [m], that a picture joins up; joint points are
            added by themselves, so this is for what no joint touches.
        inertia: mass, centre and moments; None leaves them to `rods.with_inertia`.
    """

    name: str
    outline: tuple[Vector, ...] = ()
    inertia: Inertia | None = None

    @property
    def seen(self) -> bool:
        """Whether it stands for a body; motions need not say where others are."""
        return not self.name.startswith(UNSEEN)


@dataclass(frozen=True, slots=True)
class End:
    """One side of a joint, in the frame of the link it belongs to.

    Attributes:
        link: name of the link.
        point: where the joint is, in [m].
        axis: direction of the joint's axis; made a unit vector.
        mark: direction across the axis from which the joint's angle is counted; made a unit vector
            across the axis. None takes the frame's x axis, or y where x lies along the axis.
        marked: whether a mark was given.
    """

    link: str
    point: Vector = ORIGIN
    axis: Vector = EZ
    mark: Vector | None = None
    marked: bool = field(init=False, default=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "marked", self.mark is not None)
        point, axis = _finite(self, "point", self.point), _finite(self, "axis", self.axis)
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            raise InputError(f"axis of a joint on link {self.link!r} is the zero vector; give a direction")
        given = self.mark
        if given is None:
            given = EX if abs(axis[0]) < 0.9 * length else EY
        mark = _finite(self, "mark", given)
        # those of another End stay what they are to the last bit
        if self.mark is None or not _unit_and_across(axis, mark):
            axis = axis / length
            mark = mark - axis * (axis @ mark)
            length = float(np.linalg.norm(mark))
            if not length > 1e-9:
                raise InputError(
                    f"mark {given} of a joint on link {self.link!r} lies along its axis; "
                    "give a direction across the axis"
                )
            mark = mark / length
        object.__setattr__(self, "point", tuple(point.tolist()))
        object.__setattr__(self, "axis", tuple(axis.tolist()))
        object.__setattr__(self, "mark", tuple(mark.tolist()))

    @property
    def frame(self) -> Array:
        """The joint's frame in the link's: columns mark, axis x mark, axis; (3, 3), not to be written to."""
        assert self.mark is not None
        return _frame(self.axis, self.mark)


def _vector(values: Array) -> Vector:
    return (float(values[0]), float(values[1]), float(values[2]))


@cache
def _frame(axis: Vector, mark: Vector) -> Array:
    frame = np.column_stack([mark, np.cross(axis, mark), axis])
    frame.flags.writeable = False
    return frame


@dataclass(frozen=True, slots=True)
class Joint:
    """Two links meet: point on point, axis on axis, as the kind says.

    - revolute: points and axes coincide. Coordinate: angle from a's mark to b's about the axis.
    - prismatic: axes coincide, marks stay parallel. Coordinate: displacement of b's point along the axis.
      Where neither side has a mark, the links are turned by the least that lays axis on axis; in a
      mechanism whose guess is nearer to that, as if each side had the mark it has by itself.
    - cylindrical: axes coincide. Coordinates: displacement, then angle.
    - screw: as cylindrical, and the displacement is `lead` times the turns.
    - universal: points coincide, axes cross at `cross_angle`. Coordinates: angle about a's axis,
      angle about b's; both zero where b's axis lies from a's axis towards a's mark.
    - spherical: points coincide. No coordinate.
    - planar: axes stay parallel and b's point in the plane across a's axis. Coordinates: displacements
      along a's mark and across it, then angle.
    - fixed: points coincide, axes and marks too, which may be left out likewise. No coordinate.
    - floating: nothing is held. Coordinates: the place of b's point in a's frame.

    Attributes:
        name: unique in the mechanism.
        kind: one of `model.joints.KINDS`, as above.
        a: the side nearer the frame.
        b: the other side.
        cross_angle: of a universal joint, in [rad].
        lead: of a screw, displacement a turn in [m].
        unmarked: whether no mark says how a slide turns its links.
    """

    name: str
    kind: KindName
    a: End
    b: End
    cross_angle: float = np.pi / 2
    lead: float = 0.0
    unmarked: bool = field(init=False, default=False, compare=False, repr=False)

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
        if not abs(number(self.lead)) < np.inf or KINDS[self.kind].led != (self.lead != 0.0):
            raise InputError(
                f"lead of {self.kind} joint {self.name!r} is {self.lead} m; "
                "give a screw its displacement a turn, and no other joint any"
            )
        if 0 in KINDS[self.kind].alike and not (self.a.marked or self.b.marked):
            side = self.a.frame
            mark = least_turned(np.array(self.b.axis), side[:, 2], side[:, 0])
            if np.abs(mark - np.array(self.b.mark)).max() > ROUNDED:
                object.__setattr__(self, "b", replace(self.b, mark=_vector(mark)))
                object.__setattr__(self, "unmarked", True)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of its coordinates: the joint's own where it has one, else NAME.way, NAME.turn, NAME.1 ..."""
        return tuple(self.name + ending for ending in KINDS[self.kind].endings)


@dataclass(frozen=True, slots=True)
class Mechanism:
    """Links, joints, couplings, what is driven, and the points whose motion is wanted.

    Attributes:
        name: of the mechanism.
        links: the moving links; the frame is the link called "ground", which is not listed.
        joints: all joints.
        driver: name of the driven coordinate, or of several; a lone revolute joint is the crank.
        points: name -> (link, point in that link's frame in [m]).
        gears: couplings between revolute joints.
        guess: link -> rough pose at crank angle `start`, from which assembly begins; says which
            assembly is meant. A link left out starts where its joints to placed links put it.
        start: crank angle of the guess in [rad].
        couplings: between any coordinates.
        holds: coordinate -> value at which it is held, in [m] or [rad].
        counted: coordinate -> its value at the guess, where a pose does not tell it: turns of a joint,
            or where a driver stands exactly.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    driver: str | tuple[str, ...]
    points: Mapping[str, tuple[str, Vector]]
    gears: tuple[Gear, ...] = ()
    guess: Mapping[str, Pose] = field(default_factory=dict)
    start: float = 0.0
    couplings: tuple[Coupling, ...] = ()
    holds: Mapping[str, float] = field(default_factory=dict[str, float])
    counted: Mapping[str, float] = field(default_factory=dict[str, float])

    __repr__ = short_repr

    def __post_init__(self) -> None:
        self._require_kinds()
        names = [link.name for link in self.links]
        _unique(self.name, "link", [GROUND, *names])
        _unique(self.name, "joint", [joint.name for joint in self.joints])
        _unique(self.name, "point", [*self.points])
        for joint in self.joints:
            for end in (joint.a, joint.b):
                _known(f"joint {joint.name!r}", "link", end.link, [GROUND, *names])
        for point, (link, place) in self.points.items():
            _known(f"point {point!r}", "link", link, [GROUND, *names])
            if numbers(place).shape != (3,) or not (np.abs(numbers(place)) < FARTHEST).all():
                raise InputError(
                    f"point {point!r} is at {place}; give three finite numbers in [m] below {FARTHEST:g}"
                )
        for link, pose in self.guess.items():
            _known("guess", "link", link, names)
            _require_pose(link, pose)
        if not abs(number(self.start)) < np.inf:
            raise InputError(f"{self.name}: start is {self.start} rad; give a finite crank angle")
        revolutes = [joint.name for joint in self.joints if KINDS[joint.kind].hinge]
        object.__setattr__(self, "joints", tuple(self._marked(joint) for joint in self.joints))
        self._require_coordinates()
        for gear in self.gears:
            called = f"gear {gear.driver!r}-{gear.driven!r}"
            for joint in (gear.driver, gear.driven):
                _known("gear", "revolute joint", joint, revolutes)
            if not 0.0 < abs(number(gear.ratio)) < np.inf:
                raise InputError(f"ratio of {called} is {gear.ratio}; give a number, not 0")
            if not abs(number(gear.phase)) < np.inf:
                raise InputError(f"phase of {called} is {gear.phase}; give a finite number in [rad]")

    def _marked(self, joint: Joint) -> Joint:
        """Return a joint with the marks that the guess means, where none are given."""
        poses = {GROUND: IDENTITY, **self.guess}
        if not (joint.unmarked and joint.a.link in poses and joint.b.link in poses):
            return joint
        by_itself = End(joint.b.link, joint.b.point, joint.b.axis)
        turned = numbers(poses[joint.a.link].rotation).T @ numbers(poses[joint.b.link].rotation)
        meant, off = guessed(joint.a.frame, (joint.b.frame, by_itself.frame), turned)
        if off > MEANT:
            raise InputError(
                f"{self.name}: {joint.kind} joint {joint.name!r} has no marks, and the guess turns its "
                f"links by {np.rad2deg(off):.3g} deg about its axis from where they are without any; give "
                "each side a mark, a direction across the axis that meets the other side's"
            )
        return replace(joint, b=replace(joint.b, mark=by_itself.mark)) if meant else joint

    def _require_coordinates(self) -> None:
        """Refuse drivers, holds and couplings of what is no coordinate, and one prescribed twice."""
        known = [name for joint in self.joints for name in joint.coordinates]
        drivable = [name for joint in self.joints if KINDS[joint.kind].drivable for name in joint.coordinates]
        for name in self.drivers:
            _known("driver", "coordinate", name, drivable)
        for what, given in (("holds", self.holds), ("counted", self.counted)):
            for name, value in require(f"{what} of {self.name!r}", given, Mapping).items():
                _known(what, "coordinate", name, known)
                if not abs(number(value)) < np.inf:
                    raise InputError(f"{what}: coordinate {name!r} is {value}; give a finite number")
        _unique(self.name, "driver or hold of the coordinate", [*self.drivers, *self.holds])
        for coupling in self.couplings:
            for name in coupling.coordinates:
                _known(f"coupling {coupling.name!r}", "coordinate", name, known)

    def _require_kinds(self) -> None:
        for name, kind in (("links", Link), ("joints", Joint), ("gears", Gear), ("couplings", Coupling)):
            given: object = getattr(self, name)
            if not isinstance(given, tuple | list):
                raise InputError(f"{name} of {self.name!r} are of type {type(given).__name__}; give a tuple")
            for one in given:
                require(f"one of the {name} of {self.name!r}", one, kind)
        for name in ("points", "guess"):
            require(f"{name} of {self.name!r}", getattr(self, name), Mapping)
        for point, place in self.points.items():
            if isinstance(place, str) or len(place) != 2:
                raise InputError(f"point {point!r} is {place}; give a link and three numbers in its frame")

    @property
    def drivers(self) -> tuple[str, ...]:
        """Names of the driven coordinates."""
        return (self.driver,) if isinstance(self.driver, str) else tuple(self.driver)

    @property
    def has_crank(self) -> bool:
        """Whether one revolute joint is all that is driven."""
        return len(self.drivers) == 1 and KINDS[self.driven_joints[0].kind].hinge

    @property
    def crank(self) -> Joint:
        """The revolute joint that alone is driven.

        Raises:
            InputError: where another joint is driven, or several are.
        """
        if not self.drivers:
            raise InputError(f"{self.name}: nothing is driven; name a driver, as in driver='crank'")
        if not self.has_crank:
            raise InputError(
                f"{self.name} has no crank: {', '.join(self.drivers)} "
                f"{'is' if len(self.drivers) == 1 else 'are'} driven, and this needs one revolute driver"
            )
        return self.driven_joints[0]

    @property
    def driven_joints(self) -> tuple[Joint, ...]:
        """The joints whose coordinates are driven, in the order of the drivers."""
        of = {name: joint for joint in self.joints for name in joint.coordinates}
        return tuple(of[name] for name in self.drivers)

    def unit(self, coordinate: str) -> str:
        """Return the unit of a coordinate, "m" or "rad"."""
        of = {
            name: unit
            for joint in self.joints
            for name, unit in zip(joint.coordinates, KINDS[joint.kind].units, strict=True)
        }
        return of[coordinate]

    @property
    def straight(self) -> frozenset[str]:
        """Names of those drivers, holds and couplings whose effort is a force."""
        named = [*((law.label, next(iter(law.left_terms))) for law in self.laws)]
        named += [(name, name) for name in (*self.drivers, *self.holds)]
        return frozenset(called for called, of in named if self.unit(of) == "m")

    @property
    def laws(self) -> tuple[Coupling, ...]:
        """All couplings: those of gears, of screws, and those of its own, in this order."""
        gears = tuple(
            Coupling(gear.name, gear.driven, gear.driver, (gear.phase, gear.ratio), turns=True)
            for gear in self.gears
        )
        screws = tuple(
            Coupling(joint.name, joint.coordinates[0], joint.coordinates[1], (0.0, joint.lead / TURN))
            for joint in self.joints
            if KINDS[joint.kind].led
        )
        return gears + screws + tuple(self.couplings)

    def joint(self, name: str) -> Joint:
        """Return the joint of that name."""
        _known(f"mechanism {self.name!r}", "joint", name, [joint.name for joint in self.joints])
        return next(joint for joint in self.joints if joint.name == name)

    def ends(self, link: str) -> list[End]:
        """Return the joint ends that lie on a link."""
        return [end for joint in self.joints for end in (joint.a, joint.b) if end.link == link]

    @property
    def size(self) -> float:
        """The longest distance between two points of one link, in [m]: the yardstick of this mechanism."""
        if not self.links:
            return 1.0  # nothing moves by which it could be measured
        held = {name: list[Vector]() for name in (GROUND, *(link.name for link in self.links))}
        for joint in self.joints:
            for end in (joint.a, joint.b):
                held[end.link].append(end.point)
        joints = max(_extent(points) for points in held.values())
        for link in self.links:
            held[link.name] += link.outline
        for link, point in self.points.values():
            held[link].append(point)
        whole = max(_extent(points) for points in held.values())
        if joints > ONE_PLACE * whole:
            return joints
        # all joints of each link in one place, as in pendulums and spherical linkages: the rest counts
        if not whole > 0.0:
            raise InputError(
                f"{self.name} has no extent: all joints, outlines and points of each link lie in one place; "
                "give one of them another place"
            )
        return whole

    def with_guess(self, guess: Mapping[str, Pose], start: float) -> "Mechanism":
        """Return the same mechanism with another place to start assembly from."""
        return replace(self, guess=dict(guess), start=start)


def described(source: object) -> Mechanism:
    """Return a mechanism, given itself or what has one, as those of the catalogue have.

    Raises:
        InputError: for anything else.
    """
    return require("a mechanism", getattr(source, "mechanism", source), Mechanism)


def joint_coordinate(joint: Joint, a: Pose, b: Pose) -> Array:
    """Return the coordinates of a joint between two posed links, (..., k).

    k is 1 for revolute and prismatic joints, 2 for cylindrical and universal ones, 0 for spherical
    ones; angles in (-pi, pi] rad, displacements in [m].
    """
    gap = b.point(joint.b.point) - a.point(joint.a.point)
    frame_a, frame_b = a.rotation @ joint.a.frame, b.rotation @ joint.b.frame  # (..., 3, 3)
    return coordinates(KINDS[joint.kind], gap, frame_a, frame_b, joint.cross_angle)


def _unit_and_across(axis: Array, mark: Array) -> bool:
    """Whether axis and mark are unit vectors across each other already, to rounding."""
    both = np.column_stack([axis, mark])
    return bool(np.abs(both.T @ both - np.eye(2)).max() < ROUNDED)


def _finite(end: End, what: str, value: Vector) -> Array:
    vector = numbers(value)
    if vector.shape != (3,) or not (np.abs(vector) < FARTHEST).all():
        raise InputError(
            f"{what} {value} of a joint on link {end.link!r} is not three finite numbers below {FARTHEST:g}"
        )
    return vector


def _require_pose(link: str, pose: Pose) -> None:
    require(f"the guess for link {link!r}", pose, Pose)
    for what, shape in (("position", (3,)), ("rotation", (3, 3))):
        values = numbers(getattr(pose, what))
        if values.shape != shape or not np.isfinite(values).all():
            raise InputError(
                f"the guess for link {link!r} has a {what} of shape {values.shape} or with NaN; "
                f"give finite numbers of shape {shape}"
            )


def _extent(points: list[Vector]) -> float:
    """Return the longest distance between two points."""
    places = np.array(points).reshape(-1, 3)
    # the frame may hold thousands: not all pairs at once
    rows = (places[i : i + ROWS, None] - places[None] for i in range(0, len(places), ROWS))
    return float(np.sqrt(max(((gaps**2).sum(-1).max(initial=0.0) for gaps in rows), default=0.0)))


def _unique(mechanism: str, what: str, names: list[str]) -> None:
    for name in names:
        if not name.strip() or any(character < " " for character in name):
            raise InputError(
                f"mechanism {mechanism!r} has a {what} called {name!r}; give it a name of letters in one line"
            )
        if names.count(name) > 1:
            raise InputError(f"mechanism {mechanism!r} has more than one {what} called {name!r}; rename one")


def _known(who: str, what: str, name: str, known: list[str]) -> None:
    if name not in known:
        raise InputError(f"{who} names {what} {name!r}, but there are only {', '.join(known)}")
