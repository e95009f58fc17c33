"""Description of a mechanism: links, joints, couplings, drivers and tracked points.

A `Mechanism` is plain data without positions in space. The analytic solvers and MuJoCo solve these.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, TypeVar

import numpy as np

from mechsim.errors import InputError, first_names
from mechsim.mechanism.joint_kinds import KINDS
from mechsim.mechanism.joints import MAX_GUESS_ERROR, Coupling, End, Gear, Joint, guessed_frame
from mechsim.mechanism.links import GROUND, IDENTITY, MAX_COORDINATE, VIRTUAL_PREFIX, Link, Pose, Vector
from mechsim.mechanism.motion import short_repr
from mechsim.numerics.arrays import REVOLUTION, Array, number, numbers, require

if TYPE_CHECKING:
    from mechsim.mechanism.contacts import Contact

Up = Literal["x", "y", "z", "-x", "-y", "-z"]
AXES: tuple[Up, ...] = ("x", "y", "z", "-x", "-y", "-z")


def against(gravity: Sequence[float]) -> Up | None:
    """Return the coordinate axis nearest to the direction against gravity; None without gravity."""
    largest = int(np.argmax(np.abs(gravity)))
    if not abs(gravity[largest]) > 0.0:
        return None
    return AXES[largest] if gravity[largest] < 0.0 else AXES[3 + largest]


def unit_vector(up: Up) -> Array:
    """Return the unit vector of an axis, (3,)."""
    return np.eye(3)["xyz".index(up[-1])] * (-1.0 if up[0] == "-" else 1.0)


def require_axis(who: str, up: object) -> None:
    """Raise InputError unless `up` names a coordinate axis or is None."""
    if up is not None and up not in AXES:
        raise InputError(f"{who}: up is {up!r}; it can be {', '.join(AXES)}")


Source = TypeVar("Source")

# joints of a link within this fraction of its largest distance count as coincident: digits of model files
COINCIDENT = 1e-5
# largest number of characters in a name
MAX_NAME_LENGTH = 200
# points per block of the matrix of distances, which limits memory
BLOCK = 500


@dataclass(frozen=True)
class Mechanism:
    """A mechanism: links, joints, couplings, drivers and tracked points.

    Attributes:
        name: name of the mechanism.
        links: the moving links; the frame is the link "ground", which is not listed.
        joints: all joints.
        driver: name or names of the driven coordinates; a single revolute joint is the crank.
        points: name of a tracked point -> (link, point in that link's frame in [m]).
        gears: couplings between revolute joints.
        guess: link -> approximate pose at crank angle `start`. Assembly starts from it, and it selects the
            assembly mode. The joints of a link without guess determine its initial pose.
        start: crank angle of the guess in [rad].
        couplings: couplings between any coordinates.
        locked: coordinate -> its constant value, in [m] or [rad].
        guess_coordinates: coordinate -> its value at the guess, in [m] or [rad], if a pose does not determine
            it: revolutions of a joint, or the exact position of a driver.
        up: coordinate axis that points up in pictures, such as "z" or "-y"; None lets the pictures choose.
        contacts: joint on a curve or cam -> what its file describes, of which the other joints are equations.
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
    guess_coordinates: Mapping[str, float] = field(default_factory=dict[str, float])
    up: Up | None = None
    contacts: Mapping[str, Contact] = field(default_factory=dict)

    __repr__ = short_repr

    def __post_init__(self) -> None:
        self._require_kinds()
        _require_name("a mechanism is called", self.name)
        require_axis(self.name, self.up)
        _unique(self.name, "link", self.link_names)
        _unique(self.name, "joint", [joint.name for joint in self.joints])
        _unique(self.name, "point", [*self.points])
        for joint in self.joints:
            for link in joint.links:
                _require_known(f"joint {joint.name!r}", "link", link, self.link_names)
        for point, (link, _) in self.points.items():
            _require_known(f"point {point!r}", "link", link, self.link_names)
        for link, pose in self.guess.items():
            _require_known("guess", "link", link, self.link_names[1:])
            _require_pose(link, pose)
        if not abs(number(self.start)) < np.inf:
            raise InputError(f"{self.name}: start is {self.start} rad; give a finite crank angle")
        revolutes = [joint.name for joint in self.joints if KINDS[joint.kind].hinge]
        object.__setattr__(
            self, "joints", tuple(self._with_guessed_reference(joint) for joint in self.joints)
        )
        self._require_coordinates()
        for gear in self.gears:
            called = f"gear {gear.driver!r}-{gear.driven!r}"
            for joint in (gear.driver, gear.driven):
                _require_known("gear", "revolute joint", joint, revolutes)
            if not 0.0 < abs(number(gear.ratio)) < np.inf:
                raise InputError(f"ratio of {called} is {gear.ratio}; give a number, not 0")
            if not abs(number(gear.phase)) < np.inf:
                raise InputError(f"phase of {called} is {gear.phase}; give a finite number in [rad]")

    def _with_guessed_reference(self, joint: Joint) -> Joint:
        """Return a joint with the references that the guess selects, if it has none."""
        poses = {GROUND: IDENTITY, **self.guess}
        if not (joint.without_reference and joint.a.link in poses and joint.b.link in poses):
            return joint
        default = End(joint.b.link, joint.b.point, joint.b.axis)
        rotation = numbers(poses[joint.a.link].rotation).T @ numbers(poses[joint.b.link].rotation)
        chosen, error = guessed_frame(joint.a.frame, (joint.b.frame, default.frame), rotation)
        if error > MAX_GUESS_ERROR:
            raise InputError(
                f"{self.name}: {joint.kind} joint {joint.name!r} has no reference, and the guess rotates "
                f"its links by {np.rad2deg(error):.3g} deg about its axis relative to the default; give "
                "each side a reference, a direction perpendicular to the axis that is parallel to the "
                "other side's"
            )
        return replace(joint, b=replace(joint.b, reference=default.reference)) if chosen else joint

    def _require_coordinates(self) -> None:
        """Raise InputError for drivers, locks and couplings of unknown coordinates, and for repeated ones."""
        drivable = [name for joint in self.joints if KINDS[joint.kind].drivable for name in joint.coordinates]
        for name in self.drivers:
            _require_known("driver", "coordinate", name, drivable)
        for what, coordinates in (("locked", self.locked), ("guess_coordinates", self.guess_coordinates)):
            for name, value in require(f"{what} of {self.name!r}", coordinates, Mapping).items():
                _require_known(what, "coordinate", name, self.coordinates)
                if not abs(number(value)) < np.inf:
                    raise InputError(f"{what}: coordinate {name!r} is {value}; give a finite number")
        _unique(self.name, "driver or lock of the coordinate", (*self.drivers, *self.locked))
        for named in (*self.gears, *self.couplings):
            if not 0.0 <= number(named.pressure_angle or 0.0) < np.pi / 2:
                raise InputError(
                    f"pressure angle of coupling {named.name!r} is {named.pressure_angle} rad; "
                    "give 0 or more, and less than 90 deg"
                )
        for coupling in self.couplings:
            for name in coupling.coordinates:
                _require_known(f"coupling {coupling.name!r}", "coordinate", name, self.coordinates)

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
        for point, entry in self.points.items():
            if isinstance(entry, str) or len(entry) != 2:
                raise InputError(f"point {point!r} is {entry}; give a link and three numbers in its frame")
            position = numbers(entry[1])
            if position.shape != (3,) or not (np.abs(position) < MAX_COORDINATE).all():
                raise InputError(
                    f"point {point!r} is at {entry[1]}; give three finite numbers in [m] below "
                    f"{MAX_COORDINATE:g}"
                )

    @property
    def drivers(self) -> tuple[str, ...]:
        """Names of the driven coordinates."""
        return (self.driver,) if isinstance(self.driver, str) else tuple(self.driver)

    @cached_property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the coordinates of all joints."""
        return tuple(name for joint in self.joints for name in joint.coordinates)

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """Names of the ground and of the moving links."""
        return (GROUND, *(link.name for link in self.links))

    @cached_property
    def has_crank(self) -> bool:
        """Whether the only driver is a revolute joint."""
        return len(self.drivers) == 1 and KINDS[self.driven_joints[0].kind].hinge

    @property
    def crank(self) -> Joint:
        """The revolute joint that is the only driver.

        Raises:
            InputError: if another kind of joint or several coordinates are driven.
        """
        self.require_driver()
        if not self.has_crank:
            raise InputError(
                f"{self.name} has no crank: {', '.join(self.drivers)} "
                f"{'is' if len(self.drivers) == 1 else 'are'} driven, and this needs one revolute driver"
            )
        return self.driven_joints[0]

    def require_driver(self) -> None:
        """Raise InputError for a mechanism without drivers."""
        if not self.drivers:
            drivable = [name for j in self.joints if KINDS[j.kind].drivable for name in j.coordinates]
            remedy = (
                f"name a driver, as in --drive {drivable[0]}=LAW or driver={drivable[0]!r}"
                if drivable
                else "no law prescribes the motion of its joints; mechsim show and check describe it"
            )
            raise InputError(f"{self.name}: nothing is driven; {remedy}")

    @cached_property
    def driven_joints(self) -> tuple[Joint, ...]:
        """The joints with driven coordinates, in the order of the drivers."""
        return tuple(self.joint_with(name)[0] for name in self.drivers)

    def unit(self, coordinate: str) -> Literal["m", "rad"]:
        """Return the unit of a coordinate."""
        joint, number_in_joint = self.joint_with(coordinate)
        return KINDS[joint.kind].units[number_in_joint]

    def effort_unit(self, coordinate: str) -> str:
        """Return the unit of the force or torque along a coordinate, "N" or "N m"."""
        return "N" if self.unit(coordinate) == "m" else "N m"

    @property
    def straight(self) -> frozenset[str]:
        """Names of drivers, locked coordinates and couplings that have a force, not a torque."""
        named = [*((name, next(iter(law.left_terms))) for name, law in self.named_laws.items())]
        named += [(name, name) for name in (*self.drivers, *self.locked)]
        return frozenset(called for called, coordinate in named if self.unit(coordinate) == "m")

    @property
    def laws(self) -> tuple[Coupling, ...]:
        """All couplings: of gears, of screws, and `couplings`, in this order."""
        screws = tuple(
            Coupling(joint.name, joint.coordinates[0], joint.coordinates[1], (0.0, joint.lead / REVOLUTION))
            for joint in self.joints
            if KINDS[joint.kind].helical
        )
        return (*(gear.coupling for gear in self.gears), *screws, *self.couplings)

    @cached_property
    def named_laws(self) -> dict[str, Coupling]:
        """All couplings by name: both sides in words, numbered if repeated."""
        named: dict[str, Coupling] = {}
        for law in self.laws:
            repeats = sum(law.label == other.label for other in named.values())
            named[f"{law.label} {repeats + 1}" if repeats else law.label] = law
        return named

    @property
    def one_sided_curves(self) -> list[str]:
        """Names of the contacts of rollers with curves, which can only push."""
        return [
            n for n, contact in self.contacts.items() if contact.one_sided and hasattr(contact.shape, "axes")
        ]

    def joint(self, name: str) -> Joint:
        """Return the joint with a name."""
        _require_known(f"mechanism {self.name!r}", "joint", name, self._joint_of)
        return self._joint_of[name]

    @cached_property
    def _joint_of(self) -> dict[str, Joint]:
        return {joint.name: joint for joint in self.joints}

    def joint_with(self, coordinate: str) -> tuple[Joint, int]:
        """Return the joint with a coordinate, and the number of the coordinate in it."""
        return next(
            (joint, joint.coordinates.index(coordinate))
            for joint in self.joints
            if coordinate in joint.coordinates
        )

    def ends(self, link: str) -> list[End]:
        """Return the joint ends on a link."""
        return self._ends_by_link.get(link, [])

    @cached_property
    def _ends_by_link(self) -> dict[str, list[End]]:
        """The joint ends on each link, in the order of the joints."""
        ends: dict[str, list[End]] = {}
        for joint in self.joints:
            for end in (joint.a, joint.b):
                ends.setdefault(end.link, []).append(end)
        return ends

    @cached_property
    def characteristic_length(self) -> float:
        """Characteristic length: longest distance between two joints of a link, in [m].

        Without one it is that between any points of a link, else that from these to its centre of mass; 1 m
        for bodies whose points all coincide, as a mass on a slide.
        """
        if not self.links:
            return 1.0  # no link, no length
        points_of = {name: list[Vector]() for name in self.link_names}
        for joint in self.joints:
            for end in (joint.a, joint.b):
                points_of[end.link].append(end.point)
        joints = max(_extent(points) for points in points_of.values())
        for link in self.links:
            points_of[link.name] += link.outline
        for link, point in self.points.values():
            points_of[link].append(point)
        whole = max(_extent(points) for points in points_of.values())
        if joints > COINCIDENT * whole:
            return joints
        # coincident joints on each link, as in pendulums and spherical linkages: use all points
        if whole > 0.0:
            return whole
        centres = [
            _extent([*points_of[link.name], link.inertia.centre]) for link in self.links if link.inertia
        ]
        if not centres:
            raise InputError(
                f"{self.name} has no extent: all joints, outlines and points of each link coincide; "
                "move one of them, or give a link its inertia"
            )
        return max(centres) or 1.0

    @cached_property
    def inner_joints(self) -> frozenset[str]:
        """The joints that replace one on a curve or cam, without the one that transmits its force."""
        names = (joint.name for joint in self.joints)
        return frozenset(name for name in names if name.startswith(VIRTUAL_PREFIX) or name in self.contacts)

    @property
    def written_joints(self) -> list[Joint]:
        """The joints of the file; one on a curve or cam is its coordinate between the links that it joins."""
        result, forces = list[Joint](), {contact.force_joint for contact in self.contacts.values()}
        for joint in self.joints:
            contact = self.contacts.get(joint.name)
            if contact is not None:
                end = self.joint(contact.force_joint).b
                result.append(replace(joint, a=replace(joint.a, link=contact.carrier), b=end))
            elif joint.name not in self.inner_joints and joint.name not in forces:
                result.append(joint)
        return result

    def contact_of(self, law: Coupling) -> str:
        """Return the joint on a curve or cam whose shape a coupling states; empty for other couplings."""
        joint = law.name.rpartition(".")[0]
        return joint if joint in self.contacts else ""

    def with_guess(self, guess: Mapping[str, Pose], start: float) -> Mechanism:
        """Return the same mechanism with another guess at another crank angle in [rad]."""
        return replace(self, guess=dict(guess), start=start)


def require_polynomials(mechanism: Mechanism, what: str) -> None:
    """Raise InputError for a coupling by a function where only polynomials can be handled."""
    for law in mechanism.laws:
        if joint := mechanism.contact_of(law):
            raise InputError(
                f"{mechanism.name}: joint {joint!r} follows a curve, and only polynomials can be {what}; "
                "solve, simulate, validate and dynamics take curves"
            )
        if law.function is not None:
            raise InputError(
                f"{mechanism.name}: coupling {law.name!r} is a function, and only polynomials can be {what}; "
                "give coefficients, of degree 4 at most"
            )


def described(source: object) -> Mechanism:
    """Return a mechanism, given itself or an object that has one, such as a catalogue mechanism.

    Raises:
        InputError: for any other object.
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
    # the frame may have thousands of points: compute the distances in blocks
    rows = (positions[i : i + BLOCK, None] - positions[None] for i in range(0, len(positions), BLOCK))
    return float(np.sqrt(max(((gaps**2).sum(-1).max(initial=0.0) for gaps in rows), default=0.0)))


def _unique(mechanism: str, what: str, names: Iterable[str]) -> None:
    for name, count in Counter(names).items():
        _require_name(f"mechanism {mechanism!r} has a {what} called", name)
        if count > 1:
            raise InputError(f"mechanism {mechanism!r} has more than one {what} called {name!r}; rename one")


def _require_name(who: str, name: str) -> None:
    """Raise InputError for a name that files, tables or pictures cannot show."""
    if not name or not name.isprintable() or name != name.strip():
        raise InputError(
            f"{who} {name!r}; give it a name of printable characters in one line, without a space at "
            "either end"
        )
    if len(name) > MAX_NAME_LENGTH:
        raise InputError(
            f"{who} {name[:20]!r}..., of {len(name)} characters; give it {MAX_NAME_LENGTH} at most"
        )


def _require_known(who: str, what: str, name: str, names: Collection[str]) -> None:
    if name not in names:
        raise InputError(f"{who} names {what} {name!r}, but there are only {first_names(names)}")


def starting_at(source: Source, angles: Array, direction: float = 1.0) -> Source:
    """Return a source in the assembly that its parameters select at the first crank angle of (n,) in [rad].

    Only a source with a sign of its assembly, such as a catalogue mechanism, has a method of this name. The
    guess of any other source selects its assembly.
    """
    select: Callable[[Array, float], Source] | None = getattr(source, "starting_at", None)
    return source if select is None else select(angles, direction)
