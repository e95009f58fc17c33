"""What a mechanism is: links, joints between them, couplings, and what is driven.

A `Mechanism` is plain data. Nothing here says where a link is in space: that is solved, by the
closed forms and `closure` on one side and by MuJoCo on the other.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, TypeVar

import numpy as np

from mechsim.errors import InputError
from mechsim.model.joint_kinds import KINDS
from mechsim.model.joints import MAX_GUESS_ERROR, Coupling, End, Gear, Joint, guessed_frame
from mechsim.model.links import FARTHEST, GROUND, IDENTITY, Link, Pose, Vector
from mechsim.model.motion import short_repr
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.numerics.inputs import number, numbers, require

Up = Literal["x", "y", "z", "-x", "-y", "-z"]
AXES: tuple[Up, ...] = ("x", "y", "z", "-x", "-y", "-z")


def against(gravity: Sequence[float]) -> Up | None:
    """Return the coordinate axis nearest to the direction opposite to gravity; None without gravity."""
    largest = int(np.argmax(np.abs(gravity)))
    if not abs(gravity[largest]) > 0.0:
        return None
    return AXES[largest] if gravity[largest] < 0.0 else AXES[3 + largest]


def unit_vector(up: Up) -> Array:
    """Return the unit vector of an axis, (3,)."""
    return np.eye(3)["xyz".index(up[-1])] * (-1.0 if up[0] == "-" else 1.0)


def require_axis(who: str, up: object) -> None:
    """Raise InputError for what names no coordinate axis; None is allowed."""
    if up is not None and up not in AXES:
        raise InputError(f"{who}: up is {up!r}; it can be {', '.join(AXES)}")


Source = TypeVar("Source")

# joints of a link nearer to each other than this part of all that is known of the links lie in one place, but
# for the digits of their file
ONE_PLACE = 1e-5
# characters of a name
LONGEST_NAME = 200
# points whose distances to all others are taken at once
ROWS = 500


@dataclass(frozen=True)
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
        locked: coordinate -> value at which it is held, in [m] or [rad].
        counted: coordinate -> its value at the guess, where a pose does not determine it: turns of a joint,
            or where a driver stands exactly.
        up: coordinate axis that points up in pictures, as "z" or "-y"; None leaves it to the pictures.
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
    locked: Mapping[str, float] = field(default_factory=dict[str, float])
    counted: Mapping[str, float] = field(default_factory=dict[str, float])
    up: Up | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        self._require_kinds()
        _require_name("a mechanism is called", self.name)
        require_axis(self.name, self.up)
        names = [link.name for link in self.links]
        _unique(self.name, "link", [GROUND, *names])
        _unique(self.name, "joint", [joint.name for joint in self.joints])
        _unique(self.name, "point", [*self.points])
        for joint in self.joints:
            for end in (joint.a, joint.b):
                _require_known(f"joint {joint.name!r}", "link", end.link, [GROUND, *names])
        for point, (link, position) in self.points.items():
            _require_known(f"point {point!r}", "link", link, [GROUND, *names])
            if numbers(position).shape != (3,) or not (np.abs(numbers(position)) < FARTHEST).all():
                raise InputError(
                    f"point {point!r} is at {position}; give three finite numbers in [m] below {FARTHEST:g}"
                )
        for link, pose in self.guess.items():
            _require_known("guess", "link", link, names)
            _require_pose(link, pose)
        if not abs(number(self.start)) < np.inf:
            raise InputError(f"{self.name}: start is {self.start} rad; give a finite crank angle")
        revolutes = [joint.name for joint in self.joints if KINDS[joint.kind].hinge]
        object.__setattr__(self, "joints", tuple(self._marked(joint) for joint in self.joints))
        self._require_coordinates()
        for gear in self.gears:
            called = f"gear {gear.driver!r}-{gear.driven!r}"
            for joint in (gear.driver, gear.driven):
                _require_known("gear", "revolute joint", joint, revolutes)
            if not 0.0 < abs(number(gear.ratio)) < np.inf:
                raise InputError(f"ratio of {called} is {gear.ratio}; give a number, not 0")
            if not abs(number(gear.phase)) < np.inf:
                raise InputError(f"phase of {called} is {gear.phase}; give a finite number in [rad]")

    def _marked(self, joint: Joint) -> Joint:
        """Return a joint with the marks that the guess means, where none are given."""
        poses = {GROUND: IDENTITY, **self.guess}
        if not (joint.without_reference and joint.a.link in poses and joint.b.link in poses):
            return joint
        by_itself = End(joint.b.link, joint.b.point, joint.b.axis)
        rotation = numbers(poses[joint.a.link].rotation).T @ numbers(poses[joint.b.link].rotation)
        chosen, off = guessed_frame(joint.a.frame, (joint.b.frame, by_itself.frame), rotation)
        if off > MAX_GUESS_ERROR:
            raise InputError(
                f"{self.name}: {joint.kind} joint {joint.name!r} has no marks, and the guess turns its "
                f"links by {np.rad2deg(off):.3g} deg about its axis from where they are without any; give "
                "each side a reference, a direction across the axis that meets the other side's"
            )
        return replace(joint, b=replace(joint.b, reference=by_itself.reference)) if chosen else joint

    def _require_coordinates(self) -> None:
        """Refuse drivers, holds and couplings of what is no coordinate, and one prescribed twice."""
        names = [name for joint in self.joints for name in joint.coordinates]
        drivable = [name for joint in self.joints if KINDS[joint.kind].drivable for name in joint.coordinates]
        for name in self.drivers:
            _require_known("driver", "coordinate", name, drivable)
        for what, coordinates in (("locked", self.locked), ("counted", self.counted)):
            for name, value in require(f"{what} of {self.name!r}", coordinates, Mapping).items():
                _require_known(what, "coordinate", name, names)
                if not abs(number(value)) < np.inf:
                    raise InputError(f"{what}: coordinate {name!r} is {value}; give a finite number")
        _unique(self.name, "driver or hold of the coordinate", [*self.drivers, *self.locked])
        for named in (*self.gears, *self.couplings):
            if not 0.0 <= number(named.pressure_angle or 0.0) < np.pi / 2:
                raise InputError(
                    f"pressure angle of coupling {named.name!r} is {named.pressure_angle} rad; "
                    "give 0 or more, and less than 90 deg"
                )
        for coupling in self.couplings:
            for name in coupling.coordinates:
                _require_known(f"coupling {coupling.name!r}", "coordinate", name, names)

    def _require_kinds(self) -> None:
        for name, kind in (("links", Link), ("joints", Joint), ("gears", Gear), ("couplings", Coupling)):
            entries: object = getattr(self, name)
            if not isinstance(entries, tuple | list):
                raise InputError(
                    f"{name} of {self.name!r} are of type {type(entries).__name__}; give a tuple"
                )
            for entry in entries:
                require(f"one of the {name} of {self.name!r}", entry, kind)
        for name in ("points", "guess"):
            require(f"{name} of {self.name!r}", getattr(self, name), Mapping)
        for point, point_place in self.points.items():
            if isinstance(point_place, str) or len(point_place) != 2:
                raise InputError(
                    f"point {point!r} is {point_place}; give a link and three numbers in its frame"
                )

    @property
    def drivers(self) -> tuple[str, ...]:
        """Names of the driven coordinates."""
        return (self.driver,) if isinstance(self.driver, str) else tuple(self.driver)

    @cached_property
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

    @cached_property
    def driven_joints(self) -> tuple[Joint, ...]:
        """The joints whose coordinates are driven, in the order of the drivers."""
        joint_of = {name: joint for joint in self.joints for name in joint.coordinates}
        return tuple(joint_of[name] for name in self.drivers)

    def unit(self, coordinate: str) -> str:
        """Return the unit of a coordinate, "m" or "rad"."""
        unit_of = {
            name: unit
            for joint in self.joints
            for name, unit in zip(joint.coordinates, KINDS[joint.kind].units, strict=True)
        }
        return unit_of[coordinate]

    def effort_unit(self, coordinate: str) -> str:
        """Return the unit of the effort along a coordinate, "N" or "N m"."""
        return "N" if self.unit(coordinate) == "m" else "N m"

    @property
    def straight(self) -> frozenset[str]:
        """Names of those drivers, holds and couplings whose effort is a force."""
        named = [*((name, next(iter(law.left_terms))) for name, law in self.named_laws.items())]
        named += [(name, name) for name in (*self.drivers, *self.locked)]
        return frozenset(called for called, coordinate in named if self.unit(coordinate) == "m")

    @property
    def laws(self) -> tuple[Coupling, ...]:
        """All couplings: those of gears, of screws, and those of its own, in this order."""
        gears = tuple(
            Coupling(
                gear.name,
                gear.driven,
                gear.driver,
                (gear.phase, gear.ratio),
                turns=True,
                pressure_angle=gear.pressure_angle,
            )
            for gear in self.gears
        )
        screws = tuple(
            Coupling(joint.name, joint.coordinates[0], joint.coordinates[1], (0.0, joint.lead / REVOLUTION))
            for joint in self.joints
            if KINDS[joint.kind].helical
        )
        return gears + screws + tuple(self.couplings)

    @property
    def named_laws(self) -> dict[str, Coupling]:
        """All couplings by the names of their efforts: both sides in words, numbered where these repeat."""
        named: dict[str, Coupling] = {}
        for law in self.laws:
            times = sum(law.label == other.label for other in named.values())
            named[f"{law.label} {times + 1}" if times else law.label] = law
        return named

    def joint(self, name: str) -> Joint:
        """Return the joint of that name."""
        _require_known(f"mechanism {self.name!r}", "joint", name, [joint.name for joint in self.joints])
        return next(joint for joint in self.joints if joint.name == name)

    def ends(self, link: str) -> list[End]:
        """Return the joint ends that lie on a link."""
        return [end for joint in self.joints for end in (joint.a, joint.b) if end.link == link]

    @property
    def characteristic_length(self) -> float:
        """The longest distance between two points of one link, in [m]: its characteristic length."""
        if not self.links:
            return 1.0  # nothing moves by which it could be measured
        points_of = {name: list[Vector]() for name in (GROUND, *(link.name for link in self.links))}
        for joint in self.joints:
            for end in (joint.a, joint.b):
                points_of[end.link].append(end.point)
        joints = max(_extent(points) for points in points_of.values())
        for link in self.links:
            points_of[link.name] += link.outline
        for link, point in self.points.values():
            points_of[link].append(point)
        whole = max(_extent(points) for points in points_of.values())
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
    positions = np.array(points).reshape(-1, 3)
    # the frame may hold thousands: not all pairs at once
    rows = (positions[i : i + ROWS, None] - positions[None] for i in range(0, len(positions), ROWS))
    return float(np.sqrt(max(((gaps**2).sum(-1).max(initial=0.0) for gaps in rows), default=0.0)))


def _unique(mechanism: str, what: str, names: list[str]) -> None:
    for name in names:
        _require_name(f"mechanism {mechanism!r} has a {what} called", name)
        if names.count(name) > 1:
            raise InputError(f"mechanism {mechanism!r} has more than one {what} called {name!r}; rename one")


def _require_name(who: str, name: str) -> None:
    """Refuse a name that no file, table or picture could show as it is."""
    if not name or not name.isprintable() or name != name.strip():
        raise InputError(
            f"{who} {name!r}; give it a name of printable characters in one line, without a space at "
            "either end"
        )
    if len(name) > LONGEST_NAME:
        raise InputError(f"{who} {name[:20]!r}..., of {len(name)} characters; give it {LONGEST_NAME} at most")


def _require_known(who: str, what: str, name: str, names: list[str]) -> None:
    if name not in names:
        raise InputError(f"{who} names {what} {name!r}, but there are only {', '.join(names)}")


def starting_at(source: Source, angles: Array, direction: float = 1.0) -> Source:
    """Return a source in the assembly that its parameters select at the first of crank angles, (n,) in [rad].

    Only a source with a sign of its assembly, as a catalogue mechanism has one, has a method of this name.
    The guess of any other selects its assembly.
    """
    select: Callable[[Array, float], Source] | None = getattr(source, "starting_at", None)
    return source if select is None else select(angles, direction)
