"""Drivers, motion laws, start, locked coordinates and couplings of a TOML file."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from mechsim.errors import InputError
from mechsim.files import is_table
from mechsim.io.toml_values import KeyPath, Values, suggestion, tabled_function, written_function
from mechsim.mechanism.joint_kinds import KINDS, KindName, kinds_that
from mechsim.mechanism.joints import Belt, Coupling, Gear, state_variable
from mechsim.numerics.arrays import REVOLUTION
from mechsim.units import ALONG, Unit

if TYPE_CHECKING:
    from mechsim.io.law_text import MotionLaw, Start
    from mechsim.mechanism.nonlinear_springs import NonlinearSpring

# excess of a rope over its path that is rounding, relative to their lengths
SLACK = 1e-12
# name of the joint that is the default driver
CRANK = "crank"


@dataclass
class FileLimits:
    """The limits of coordinates of a file, in SI.

    Attributes:
        ranges: coordinate -> lower and upper limit that no motion exceeds.
        restitution: coordinate, or gap of a coupling -> coefficient of restitution there, if stated.
        stops: soft stops, which yield.
    """

    ranges: dict[str, tuple[float, float]] = field(default_factory=dict[str, tuple[float, float]])
    restitution: dict[str, float] = field(default_factory=dict[str, float])
    stops: "list[NonlinearSpring]" = field(default_factory=list["NonlinearSpring"])


def leaves(table: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield the key paths and entries of nested tables, without the tables themselves."""
    for key, entry in table.items():
        if isinstance(entry, dict):
            yield from leaves(cast(Mapping[str, Any], entry), (*path, key))
        else:
            yield (*path, key), entry


@dataclass(frozen=True)
class FileMotionLaw:
    """A motion law in a file: numbers without a unit are in the file's units, and parameters have names.

    Attributes:
        coordinates: the file's coordinates.
        text: its text.
        path: its key path.
    """

    coordinates: "FileCoordinates"
    text: str
    path: KeyPath

    def parse(self, name: str, unit: str, start: "Start") -> "MotionLaw":
        """Return the motion law, as `parse_motion_law`."""
        from mechsim.io.law_text import parse_motion_law

        values = self.coordinates.values
        text = values.source.sibling(self.text) if is_table(self.text) else self.text
        with values.source.error_context(self.path):
            scale, parameters = values.in_si(1.0, self.coordinates.units[name]), values.parameters
            return parse_motion_law(text, name, unit, start, default_unit=scale, parameters=parameters)


@dataclass(frozen=True)
class FileCoordinates:
    """The joint coordinates of a file, which name its drivers, locked coordinates and couplings.

    Attributes:
        values: reader of the file's numbers.
        read: contents of the file.
    """

    values: Values
    read: Mapping[str, Any]

    @cached_property
    def kinds(self) -> dict[str, KindName]:
        """Coordinate -> kind of its joint."""
        kinds: dict[str, KindName] = {name: joint["kind"] for name, joint in self.read["joints"].items()}
        return {name + ending: kind for name, kind in kinds.items() for ending in KINDS[kind].suffixes}

    @cached_property
    def units(self) -> dict[str, Unit]:
        """Coordinate -> "m" or "rad"."""
        kinds = {name: KINDS[joint["kind"]] for name, joint in self.read["joints"].items()}
        pairs = ((name, zip(kind.suffixes, kind.units, strict=True)) for name, kind in kinds.items())
        return {name + ending: unit for name, suffixes in pairs for ending, unit in suffixes}

    def require(self, name: str, path: KeyPath) -> None:
        """Raise InputError for an unknown coordinate."""
        if name not in self.units:
            raise self.error(path, f"names coordinate {name!r}{suggestion(name, self.units)}")

    def error(self, path: KeyPath, reason: str) -> InputError:
        """Return the error of a key; the reason follows the key and its value."""
        return self.values.source.error(path, reason)

    def value(self, name: str, written: Any, path: KeyPath) -> float:
        """Return the value of a coordinate in SI."""
        self.require(name, path)
        return self.values.quantity(written, self.units[name], path)

    def table(self, key: str) -> dict[str, tuple[KeyPath, Any]]:
        """Return a table by coordinates: name -> its key path, and its value."""
        entries: dict[str, tuple[KeyPath, Any]] = {}
        for name, value_ in self.read.get(key, {}).items():
            components = value_ if isinstance(value_, dict) else {"": value_}
            for suffix, value in components.items():
                coordinate = f"{name}.{suffix}" if suffix else name
                path = (key, name, suffix) if suffix else (key, name)
                self.require(coordinate, path)
                entries[coordinate] = path, value
        return entries

    def drivers(self, requested: tuple[str, ...], *, still: bool) -> tuple[str, ...]:
        """Return the driven coordinates: of the file, else the requested joints, else the default ones.

        There are none if no joint can be driven, as of a spherical pendulum, or if only points or links are;
        with `still` none is required.
        """
        drivers = self.read.get("drivers") or [name for name in requested if name in self.kinds]
        if not requested and "drivers" not in self.read:
            drivers = self._default_drivers()
        drivable = any(KINDS[kind].drivable for kind in self.kinds.values())
        if not (drivers or requested or still) and drivable:
            raise InputError('no joint is driven; add drivers = ["NAME OF A JOINT"], or --drive JOINT=LAW')
        for name in drivers:
            self.require(name, ("drivers",))
            kind = self.kinds[name]
            if not KINDS[kind].drivable:  # pyright: ignore[reportArgumentType]
                only = kinds_that(lambda kind_: kind_.drivable)
                reason = f"names {kind} joint {name!r}; only a {only} one can be driven"
                raise self.error(("drivers",), reason)
        return tuple(drivers)

    def _default_drivers(self) -> tuple[str, ...]:
        """Return the joint called crank; of an open chain all that can be driven: they are independent."""
        joints = self.read["joints"]
        if CRANK in joints:
            return (CRANK,)
        links = {joint[end]["link"] for joint in joints.values() for end in ("a", "b")}
        if len(joints) >= len(links) or self.read.get("couplings"):
            return ()
        return tuple(name for name, kind in self.kinds.items() if KINDS[kind].drivable)

    def start(self, drivers: tuple[str, ...]) -> tuple[float, dict[str, float]]:
        """Return the crank angle of the guess in [rad], and the values of other coordinates at the guess."""
        stated = self.read.get("start")
        if stated is None:
            return 0.0, {}
        first = drivers[0] if drivers else ""
        if isinstance(stated, dict):
            table = self.table("start").items()
            values = {name: self.value(name, written, path) for name, (path, written) in table}
        elif len(drivers) == 1:
            values = {first: self.value(first, stated, ("start",))}
        else:
            reason = f"is one number, but {', '.join(drivers)} are driven; give a table, {{ {first} = ... }}"
            raise self.error(("start",), reason)
        if not drivers:
            return 0.0, values
        has_crank = len(drivers) == 1 and KINDS[self.kinds[first]].hinge
        return values.pop(first, 0.0) if has_crank else 0.0, values

    def locked(self, drivers: tuple[str, ...]) -> dict[str, float]:
        """Return the locked coordinates and their values in SI."""
        locked: dict[str, float] = {}
        for name, (path, value) in self.table("locked").items():
            if name in drivers:
                raise self.error(path, "is also driven; lock it, or drive it")
            locked[name] = self.value(name, value, path)
        return locked

    def initial(self) -> dict[str, float | tuple[float, ...]]:
        """Return the initial state in SI: J.q and J.v of coordinates J, J.q and J.w of spherical joints."""
        initial: dict[str, float | tuple[float, ...]] = {}
        for path, written in leaves(self.read.get("initial", {}), ("initial",)):
            text = ".".join(path[1:])
            if isinstance(written, list | tuple):
                units: tuple[Unit, ...] = ("rad/s",) * 3 if path[-1] == "w" else ("1", "1", "1", "rad")
                entries = cast(Sequence[Any], written)
                if len(entries) != len(units):
                    raise self.error(path, "is a list; give q = [X, Y, Z, ANGLE] or w = [WX, WY, WZ]")
                initial[text] = tuple(
                    self.values.quantity(entry, unit, (*path, i))
                    for i, (entry, unit) in enumerate(zip(entries, units, strict=True))
                )
                continue
            variable = state_variable(text, self.units)
            if variable is None:
                if path[-1] in ("q", "v"):
                    self.require(".".join(path[1:-1]), path)
                raise self.error(path, "is no state variable; give J.q or J.v of a coordinate J")
            name, letter = variable
            unit = self.units[name]
            unit = unit if letter == "q" else ALONG[unit]["rate"]
            initial[f"{name}.{letter}"] = self.values.quantity(written, unit, path)
        return initial

    def limits(self) -> FileLimits:
        """Return the limits of coordinates, as ranges or as soft stops."""
        limits, values = FileLimits(), self.values
        for name, entry, path in self._limit_entries():
            keys: set[str] = {*entry} if isinstance(entry, dict) else {""}
            soft = bool(keys & {"stiffness", "damping"})
            others = {"stiffness", "damping"} if soft else {"restitution"}
            if not keys <= {"lower", "upper", *others} or not keys & {"lower", "upper"}:
                reason = (
                    "needs lower or upper, and takes restitution, or stiffness and damping; give these alone"
                )
                raise self.error(path, reason)
            low, high = (
                self.value(name, entry[side], (*path, side)) if side in entry else otherwise
                for side, otherwise in (("lower", -np.inf), ("upper", np.inf))
            )
            if not low < high:
                reason = f"is from {low:.6g} to {high:.6g}; give a lower limit below the upper one"
                raise self.error(path, reason)
            if soft:
                limits.stops += self._stops(name, entry, path, (low, high))
                continue
            limits.ranges[name] = low, high
            if "restitution" in entry:
                limits.restitution[name] = restitution_of(values, entry, path)
        for name, table in self.read.get("couplings", {}).items():
            if "restitution" in table:
                limits.restitution[f"{name}.gap"] = restitution_of(values, table, ("couplings", name))
        return limits

    def _limit_entries(self) -> Iterator[tuple[str, Any, KeyPath]]:
        """Yield each limited coordinate, its limits as written, and their key path."""
        for joint, table in self.read["joints"].items():
            limits, whole = table.get("limits"), ("joints", joint, "limits")
            if limits is None:
                continue
            if not KINDS[table["kind"]].units:
                reason = f"is of a {table['kind']} joint, which has no coordinate to limit; leave it out"
                raise self.error(whole, reason)
            by_coordinate = any(isinstance(entry, dict) for entry in limits.values())
            for suffix, entry in limits.items() if by_coordinate else [("", limits)]:
                name, path = (f"{joint}.{suffix}", (*whole, suffix)) if suffix else (joint, whole)
                self.require(name, path)
                yield name, entry, path

    def _stops(
        self, name: str, entry: Any, path: KeyPath, limits: tuple[float, float]
    ) -> "list[NonlinearSpring]":
        """Return the soft stops at the limits of a coordinate."""
        if KINDS[self.kinds[name]].rod:
            raise self.error(path, "is of a rod, which has no stops; give its length alone")
        from mechsim.mechanism.nonlinear_springs import NonlinearSpring, SoftStop

        values, along = self.values, ALONG[self.units[name]]
        stiffness, damping = (
            values.quantity(entry.get(key, 0.0), along[key], (*path, key)) for key in ("stiffness", "damping")
        )
        with values.source.error_context(path):
            return [
                NonlinearSpring(name, SoftStop(limit, side, stiffness, damping))
                for limit, side in zip(limits, (-1.0, 1.0), strict=True)
                if abs(limit) < np.inf
            ]

    def motion_laws(self, drivers: tuple[str, ...]) -> dict[str, FileMotionLaw]:
        """Return the motion laws of a file's drivers."""
        laws: dict[str, FileMotionLaw] = {}
        for name, (path, text) in self.table("motion_laws").items():
            if name not in drivers:
                raise self.error(path, f"is not driven; drivers are {', '.join(drivers)}")
            laws[name] = FileMotionLaw(self, text, path)
        return laws

    def couplings(self) -> tuple[tuple[Gear, ...], tuple[Coupling, ...]]:
        """Return the gears between revolute joints, and all other couplings."""
        gears, couplings = list[Gear](), list[Coupling]()
        for name, table in self.read.get("couplings", {}).items():
            written = WrittenCoupling(self, name, table, ("couplings", name))
            with self.values.source.error_context(written.path):
                made = _coupling(written)
                if "backlash" in table:
                    made = replace(made.coupling, name=name) if isinstance(made, Gear) else made
                    made = replace(
                        made, backlash=written.value(table["driven"], table["backlash"], "backlash")
                    )
            if isinstance(made, Gear):
                gears.append(made)
            else:
                couplings.append(made)
        return tuple(gears), tuple(couplings)


def restitution_of(values: Values, entry: Mapping[str, Any], path: KeyPath) -> float:
    """Return the coefficient of restitution of an entry that has one."""
    value = values.quantity(entry["restitution"], "1", (*path, "restitution"))
    if not 0.0 <= value <= 1.0:
        raise values.source.error((*path, "restitution"), f"is {value:g}; give 0 to 1")
    return value


Side = str | dict[str, float]


@dataclass(frozen=True)
class WrittenCoupling:
    """A coupling in a file.

    Attributes:
        coordinates: the file's coordinates.
        name: its name.
        table: its table.
        path: its key path.
    """

    coordinates: FileCoordinates
    name: str
    table: Mapping[str, Any]
    path: KeyPath

    def error(self, reason: str, *keys: str) -> InputError:
        """Return the error of the coupling or of one of its keys."""
        return self.coordinates.error((*self.path, *keys), reason)

    @property
    def sides(self) -> tuple[Side, Side]:
        """The driven and the driver's side."""
        return self.table["driven"], self.table.get("driver", {})

    def value(self, side: Side, written: Any, *keys: str | int) -> float:
        """Return a value of a side in SI; of a sum in the unit of its first coordinate."""
        path = (*self.path, *keys)
        if isinstance(side, str):
            return self.coordinates.value(side, written, path)
        units: list[Unit] = [self.coordinates.units[name] for name in side]
        return self.coordinates.values.quantity(written, units[0] if units else "m", path)

    @property
    def zeros(self) -> tuple[float, float]:
        """The zero positions of the driven and the driver's side."""
        (driven, driver), (first, second) = self.sides, self.table.get("zeros", (0.0, 0.0))
        return self.value(driven, first, "zeros", 0), self.value(driver, second, "zeros", 1)

    def pair(self) -> tuple[str, str, float]:
        """Return the driven and the driving coordinate, and the driven one at zero of the other."""
        for side in ("driver", "driven"):
            if side not in self.table:
                raise self.error(f"has no {side!r}; name a coordinate")
            if not isinstance(self.table[side], str):
                reason = "is no single coordinate; name one, or give coefficients, which couple sums"
                raise self.error(reason, side)
        driven = self.table["driven"]
        return driven, self.table["driver"], self.value(driven, self.table.get("phase", 0.0), "phase")


def _coupling(written: WrittenCoupling) -> Gear | Coupling:
    table = written.table
    kinds = [key for key in COUPLINGS if key in table]
    if len(kinds) != 1:
        raise written.error(
            f"has {' and '.join(kinds) or 'none'} of ratio (a gear), radius or travel (a rack), coefficients "
            "(a polynomial), function, radii (a belt), rope; give one"
        )
    (kind,) = kinds
    make, keys = COUPLINGS[kind]
    opens = ("restitution",) if {"rope", "backlash"} & {*table} else ()
    allowed = ("driver", "driven", kind, *keys, *opens)
    if extra := [key for key in table if key not in allowed]:
        raise written.error(f"does not go with {kind!r}; leave it out", extra[0])
    for side in ("driver", "driven"):
        named = table.get(side, {})
        for coordinate in (named,) if isinstance(named, str) else named:
            written.coordinates.require(coordinate, (*written.path, side))
    if kind != "rope" and "driven" not in table:
        raise written.error("has no 'driven'; name a coordinate")
    return make(written)


def _gear(written: WrittenCoupling) -> Gear | Coupling:
    (driven, driver, phase), coordinates = written.pair(), written.coordinates
    ratio, teeth = written.table["ratio"], written.table.get("pressure_angle")
    if coordinates.units[driver] != coordinates.units[driven]:
        raise written.error("is between an angle and a displacement; give radius or travel")
    if KINDS[coordinates.kinds[driver]].hinge and KINDS[coordinates.kinds[driven]].hinge:
        return Gear(driver, driven, ratio, phase, teeth or 0.0)
    turns = coordinates.units[driver] == "rad"
    return Coupling(written.name, driven, driver, (phase, ratio), turns=turns, pressure_angle=teeth)


def _rack(written: WrittenCoupling) -> Coupling:
    """Return a rack and pinion: a displacement is the angle times the radius."""
    (driven, driver, phase), units, table = written.pair(), written.coordinates.units, written.table
    if units[driver] == units[driven]:
        raise written.error("is a rack between two coordinates of one unit; give an angle and a displacement")
    radius = table["radius"] if "radius" in table else table["travel"] / REVOLUTION
    if radius == 0.0:
        key = "radius" if "radius" in table else "travel"
        raise written.error("is 0; give a length, negative for the opposite direction", key)
    ratio, teeth = radius if units[driver] == "rad" else 1.0 / radius, table.get("pressure_angle", 0.0)
    return Coupling(written.name, driven, driver, (phase, ratio), pressure_angle=teeth)


def _polynomial(written: WrittenCoupling) -> Coupling:
    (driven, driver), table, coordinates = written.sides, written.table, written.coordinates

    def unit_in_si(side: Side) -> float:
        """Return the value in SI of the number 1 on a side; a sum of lengths and angles is in SI."""
        units: set[Unit] = {coordinates.units[name] for name in ((side,) if isinstance(side, str) else side)}
        factors = {coordinates.values.in_si(1.0, unit) for unit in units}
        return factors.pop() if len(factors) == 1 else 1.0

    coefficients: list[float] = []
    for power, number in enumerate(table["coefficients"]):
        if power == 0 and isinstance(driven, str):
            coefficients.append(written.value(driven, number, "coefficients", 0))
        else:
            plain = coordinates.values.plain_number(number, (*written.path, "coefficients", power))
            coefficients.append(plain * (unit_in_si(driven) / unit_in_si(driver) ** power))
    turns, teeth = table.get("turns", False), table.get("pressure_angle")
    return Coupling(written.name, driven, driver, tuple(coefficients), written.zeros, turns, teeth)


def _function(written: WrittenCoupling) -> Coupling:
    """Return a coupling by a function: an expression of q and the file's parameters, or a table."""
    (driven, driver), table, values = written.sides, written.table, written.coordinates.values
    text, zeros = table["function"], written.zeros
    if not driver:
        raise written.error("is a function without a driver; name the coordinate q")
    if is_table(text):
        periodic = table.get("periodic", False)
        sides, units = {"value": driven, "q": driver}, written.coordinates.units
        own: dict[str, Unit] = {
            column: units[side] for column, side in sides.items() if isinstance(side, str)
        }
        function = tabled_function(values, text, (*written.path, "function"), periodic=periodic, units=own)
    else:
        function = written_function(values, text, (*written.path, "function"))
    return Coupling(written.name, driven, driver, (), zeros, table.get("turns", False), function=function)


def _rope(written: WrittenCoupling) -> Coupling:
    """Return a rope: the sum of its path's changes is its length less the path at zero (Nikravesh, ch. 4).

    Raises:
        InputError: for unknown coordinates, or a rope that is slack where all its coordinates are stated.
    """
    coordinates, table = written.coordinates, written.table
    weights, path = dict[str, float](), (*written.path, "rope")
    for coordinate, change in table["rope"].items():
        coordinates.require(coordinate, path)
        unit = "m" if coordinates.units[coordinate] == "rad" else "1"
        weights[coordinate] = coordinates.values.quantity(change, unit, (*path, coordinate))
    if not any(weights.values()):
        raise coordinates.error(
            path, "changes with no coordinate; give the change of its path per coordinate"
        )
    length, free = table.get("length", 0.0), table.get("path", 0.0)
    stated = coordinates.table("start") if isinstance(coordinates.read.get("start"), dict) else {}
    start = {key: coordinates.value(key, value, where) for key, (where, value) in stated.items()}
    if start.keys() >= weights.keys():
        taut = free + sum(weight * start[key] for key, weight in weights.items())
        if not length <= taut + SLACK * max(abs(length), abs(taut)):
            raise written.error(
                f"is a rope of {length:g} m on a path of {taut:g} m: it is slack at the start; shorten it"
            )
    return Coupling(written.name, weights, {}, (length - free,), rope=True)


def _belt(written: WrittenCoupling) -> Coupling:
    """Return a belt or chain: angles with the ratio of the radii, opposite if it is crossed."""
    (driven, driver, phase), table = written.pair(), written.table
    if "m" in (written.coordinates.units[driver], written.coordinates.units[driven]):
        raise written.error("is a belt between coordinates that are no angles; name two rotations")
    first, second = table["radii"]
    if not min(first, second) > 0.0:
        raise written.error("is no pair of radii above 0; give driver and driven", "radii")
    pulley = table.get("tensioner", {"at": None, "radius": 0.0})
    if pulley["at"] and not pulley["radius"] > 0.0:
        raise written.error("is no radius above 0; enlarge it", "tensioner", "radius")
    belt = Belt((first, second), table.get("length", 0.0), pulley["at"], pulley["radius"])
    ratio = first / second * (-1.0 if table.get("crossed") else 1.0)
    return Coupling(written.name, driven, driver, (phase, ratio), turns=True, belt=belt)


_TEETH = ("phase", "pressure_angle", "backlash", "efficiency")
# key that determines the kind of a coupling -> its reader, and further keys of this kind
COUPLINGS: dict[str, tuple[Callable[[WrittenCoupling], Gear | Coupling], tuple[str, ...]]] = {
    "ratio": (_gear, _TEETH),
    "radius": (_rack, _TEETH),
    "travel": (_rack, _TEETH),
    "coefficients": (_polynomial, ("zeros", "turns", "pressure_angle", "backlash", "efficiency")),
    "function": (_function, ("zeros", "turns", "periodic", "backlash")),
    "radii": (_belt, ("crossed", "phase", "length", "tensioner", "backlash", "efficiency")),
    "rope": (_rope, ("length", "path")),
}
