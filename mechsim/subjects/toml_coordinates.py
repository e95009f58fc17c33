"""Drivers, motion laws, start, locked coordinates and couplings of a TOML file."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from mechsim.errors import InputError
from mechsim.files import is_table, read
from mechsim.model.coupling_functions import PlainFunction, TabledFunction
from mechsim.model.joint_kinds import KINDS, KindName, kinds_that
from mechsim.model.joints import Belt, Coupling, Gear, state_variable
from mechsim.numerics.angles import REVOLUTION
from mechsim.subjects.toml_values import KeyPath, Values, suggestion, written_function
from mechsim.units import Unit

if TYPE_CHECKING:
    from mechsim.model.nonlinear_springs import NonlinearSpring
    from mechsim.subjects.law_text import MotionLaw, Start

# excess of a rope over its path that is rounding, relative to their lengths
SLACK = 1e-12
# name of the joint that is the default driver
CRANK = "crank"


@dataclass(frozen=True)
class FileCoordinates:
    """The joint coordinates of a file, which name its drivers, locked coordinates and couplings.

    Attributes:
        values: reader of the file's numbers.
        read: contents of the file.
        kinds: coordinate -> kind of its joint.
        units: coordinate -> "m" or "rad".
    """

    values: Values
    read: Mapping[str, Any]
    kinds: Mapping[str, KindName]
    units: Mapping[str, Unit]

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

    def unit_in_si(self, name: str) -> float:
        """Return the value in SI of the number 1 without a unit for a coordinate."""
        return self.values.in_si(1.0, self.units[name])

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


def coordinates_of(values: Values, read: Mapping[str, Any]) -> FileCoordinates:
    """Return the coordinates of the joints of a file."""
    kinds: dict[str, KindName] = {}
    units: dict[str, Unit] = {}
    for name, table in read["joints"].items():
        kind = KINDS[table["kind"]]
        for ending, unit in zip(kind.suffixes, kind.units, strict=True):
            kinds[name + ending] = table["kind"]
            units[name + ending] = "m" if unit == "m" else "rad"
    return FileCoordinates(values, read, kinds, units)


def drivers_of(coordinates: FileCoordinates, requested: tuple[str, ...], *, still: bool) -> tuple[str, ...]:
    """Return the driven coordinates: of the file, else the requested joints, else the default ones.

    There are none if no joint can be driven, as of a spherical pendulum, or if only points or links are; with
    `still` none is required.
    """
    drivers = coordinates.read.get("drivers") or [name for name in requested if name in coordinates.kinds]
    if not requested and "drivers" not in coordinates.read:
        drivers = default_drivers(coordinates)
    drivable = any(KINDS[kind].drivable for kind in coordinates.kinds.values())
    if not (drivers or requested or still) and drivable:
        raise InputError('no joint is driven; add drivers = ["NAME OF A JOINT"], or --drive JOINT=LAW')
    for name in drivers:
        coordinates.require(name, ("drivers",))
        kind = coordinates.kinds[name]
        if not KINDS[kind].drivable:  # pyright: ignore[reportArgumentType]
            only = kinds_that(lambda kind_: kind_.drivable)
            reason = f"names {kind} joint {name!r}; only a {only} one can be driven"
            raise coordinates.error(("drivers",), reason)
    return tuple(drivers)


def default_drivers(coordinates: FileCoordinates) -> tuple[str, ...]:
    """Return the joint called crank; of an open chain all joints that can be driven: they are independent."""
    joints = coordinates.read["joints"]
    if CRANK in joints:
        return (CRANK,)
    links = {joint[end]["link"] for joint in joints.values() for end in ("a", "b")}
    if len(joints) >= len(links) or coordinates.read.get("couplings"):
        return ()
    return tuple(name for name, kind in coordinates.kinds.items() if KINDS[kind].drivable)


def start_of(coordinates: FileCoordinates, drivers: tuple[str, ...]) -> tuple[float, dict[str, float]]:
    """Return the crank angle of the guess in [rad], and the values of other coordinates at the guess."""
    stated = coordinates.read.get("start")
    if stated is None:
        return 0.0, {}
    first = drivers[0] if drivers else ""
    if isinstance(stated, dict):
        table = coordinates.table("start").items()
        values = {name: coordinates.value(name, written, path) for name, (path, written) in table}
    elif len(drivers) == 1:
        values = {first: coordinates.value(first, stated, ("start",))}
    else:
        reason = f"is one number, but {', '.join(drivers)} are driven; give a table, {{ {first} = ... }}"
        raise coordinates.error(("start",), reason)
    if not drivers:
        return 0.0, values
    has_crank = len(drivers) == 1 and KINDS[coordinates.kinds[first]].hinge
    return values.pop(first, 0.0) if has_crank else 0.0, values


def locked_of(coordinates: FileCoordinates, drivers: tuple[str, ...]) -> dict[str, float]:
    """Return the locked coordinates and their values in SI."""
    locked: dict[str, float] = {}
    for name, (path, value) in coordinates.table("locked").items():
        if name in drivers:
            raise coordinates.error(path, "is also driven; lock it, or drive it")
        locked[name] = coordinates.value(name, value, path)
    return locked


def leaves(table: Mapping[str, Any], path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield the key paths and entries of nested tables, without the tables themselves."""
    for key, entry in table.items():
        if isinstance(entry, dict):
            yield from leaves(cast(Mapping[str, Any], entry), (*path, key))
        else:
            yield (*path, key), entry


def initial_of(coordinates: FileCoordinates) -> dict[str, float | tuple[float, ...]]:
    """Return the initial state in SI: J.q and J.v of coordinates J, and J.q and J.w of spherical joints."""
    initial: dict[str, float | tuple[float, ...]] = {}
    for path, written in leaves(coordinates.read.get("initial", {}), ("initial",)):
        text = ".".join(path[1:])
        if isinstance(written, list | tuple):
            units: tuple[Unit, ...] = ("rad/s",) * 3 if path[-1] == "w" else ("1", "1", "1", "rad")
            entries = cast(Sequence[Any], written)
            if len(entries) != len(units):
                raise coordinates.error(path, "is a list; give q = [X, Y, Z, ANGLE] or w = [WX, WY, WZ]")
            initial[text] = tuple(
                coordinates.values.quantity(entry, unit, (*path, i))
                for i, (entry, unit) in enumerate(zip(entries, units, strict=True))
            )
            continue
        variable = state_variable(text, coordinates.units)
        if variable is None:
            if path[-1] in ("q", "v"):
                coordinates.require(".".join(path[1:-1]), path)
            raise coordinates.error(path, "is no state variable; give J.q or J.v of a coordinate J")
        name, letter = variable
        rate: Unit = "m/s" if coordinates.units[name] == "m" else "rad/s"
        unit = coordinates.units[name] if letter == "q" else rate
        initial[f"{name}.{letter}"] = coordinates.values.quantity(written, unit, path)
    return initial


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


def limits_of(coordinates: FileCoordinates) -> FileLimits:
    """Return the limits of coordinates, as ranges or as soft stops."""
    limits_read = FileLimits()
    for joint, table in coordinates.read["joints"].items():
        limits, whole = table.get("limits"), ("joints", joint, "limits")
        if limits is None:
            continue
        if not KINDS[table["kind"]].units:
            reason = f"is of a {table['kind']} joint, which has no coordinate to limit; leave it out"
            raise coordinates.error(whole, reason)
        by_coordinate = any(isinstance(entry, dict) for entry in limits.values())
        for suffix, entry in limits.items() if by_coordinate else [("", limits)]:
            name, path = (f"{joint}.{suffix}", (*whole, suffix)) if suffix else (joint, whole)
            coordinates.require(name, path)
            _add_limits(coordinates, limits_read, name, entry, path)
    for name, table in coordinates.read.get("couplings", {}).items():
        if "restitution" in table:
            value = restitution_of(coordinates.values, table, ("couplings", name))
            limits_read.restitution[f"{name}.gap"] = value
    return limits_read


def restitution_of(values: Values, entry: Mapping[str, Any], path: KeyPath) -> float:
    """Return the coefficient of restitution of an entry that has one."""
    value = values.quantity(entry["restitution"], "1", (*path, "restitution"))
    if not 0.0 <= value <= 1.0:
        raise values.source.error((*path, "restitution"), f"is {value:g}; give 0 to 1")
    return value


def _add_limits(
    coordinates: FileCoordinates, limits_read: FileLimits, name: str, entry: Any, path: KeyPath
) -> None:
    """Add the limits of one coordinate."""
    keys: set[str] = {*entry} if isinstance(entry, dict) else {""}
    soft, values = bool(keys & {"stiffness", "damping"}), coordinates.values
    others = {"stiffness", "damping"} if soft else {"restitution"}
    if not keys <= {"lower", "upper", *others} or not keys & {"lower", "upper"}:
        reason = "needs lower or upper, and takes restitution, or stiffness and damping; give these alone"
        raise coordinates.error(path, reason)
    low, high = (
        coordinates.value(name, entry[side], (*path, side)) if side in entry else otherwise
        for side, otherwise in (("lower", -np.inf), ("upper", np.inf))
    )
    if not low < high:
        reason = f"is from {low:.6g} to {high:.6g}; give a lower limit below the upper one"
        raise coordinates.error(path, reason)
    if not soft:
        limits_read.ranges[name] = low, high
        if "restitution" in entry:
            limits_read.restitution[name] = restitution_of(values, entry, path)
        return
    if KINDS[coordinates.kinds[name]].rod:
        raise coordinates.error(path, "is of a rod, which has no stops; give its length alone")
    from mechsim.model.nonlinear_springs import NonlinearSpring, SoftStop

    units: tuple[Unit, Unit] = (
        ("N/m", "N s/m") if coordinates.units[name] == "m" else ("N m/rad", "N m s/rad")
    )
    stiffness, damping = (
        values.quantity(entry.get(key, 0.0), unit, (*path, key))
        for key, unit in zip(("stiffness", "damping"), units, strict=True)
    )
    with values.source.error_context(path):
        limits_read.stops += [
            NonlinearSpring(name, SoftStop(limit, side, stiffness, damping))
            for limit, side in ((low, -1.0), (high, 1.0))
            if abs(limit) < np.inf
        ]


@dataclass(frozen=True)
class FileMotionLaw:
    """A motion law in a file: numbers without a unit are in the file's units, and parameters have names.

    Attributes:
        coordinates: the file's coordinates.
        text: its text.
        path: its key path.
    """

    coordinates: FileCoordinates
    text: str
    path: KeyPath

    def parse(self, name: str, unit: str, start: "Start") -> "MotionLaw":
        """Return the motion law, as `parse_motion_law`."""
        from mechsim.subjects.law_text import parse_motion_law

        values = self.coordinates.values
        text = values.source.sibling(self.text) if is_table(self.text) else self.text
        with values.source.error_context(self.path):
            return parse_motion_law(
                text,
                name,
                unit,
                start,
                default_unit=self.coordinates.unit_in_si(name),
                parameters=values.parameters,
            )


def motion_laws_of(coordinates: FileCoordinates, drivers: tuple[str, ...]) -> dict[str, FileMotionLaw]:
    """Return the motion laws of a file's drivers."""
    laws: dict[str, FileMotionLaw] = {}
    for name, (path, text) in (coordinates.table("motion_laws") | coordinates.table("programs")).items():
        if name not in drivers:
            raise coordinates.error(path, f"is not driven; drivers are {', '.join(drivers)}")
        laws[name] = FileMotionLaw(coordinates, text, path)
    return laws


Side = str | dict[str, float]

# key that determines the kind of a coupling -> further keys of this kind
_KEYS_OF_KIND = {
    "ratio": ("phase", "pressure_angle"),
    "radius": ("phase", "pressure_angle"),
    "travel": ("phase", "pressure_angle"),
    "coefficients": ("zeros", "turns", "pressure_angle"),
    "function": ("zeros", "turns", "periodic"),
    "radii": ("crossed", "phase", "length", "tensioner"),
    "rope": ("length", "path"),
}


def couplings_of(coordinates: FileCoordinates) -> tuple[tuple[Gear, ...], tuple[Coupling, ...]]:
    """Return the gears between revolute joints, and all other couplings."""
    made: list[Gear | Coupling] = []
    for name, table in coordinates.read.get("couplings", {}).items():
        path: KeyPath = ("couplings", name)
        with coordinates.values.source.error_context(path):
            coupling = _coupling(coordinates, name, table, path)
            if "backlash" in table:
                play = _zero(coordinates, table["driven"], table["backlash"], (*path, "backlash"))
                coupling = replace(_law(name, coupling), backlash=play)
            made.append(coupling)
    gears = tuple(coupling for coupling in made if isinstance(coupling, Gear))
    return gears, tuple(coupling for coupling in made if not isinstance(coupling, Gear))


def _law(name: str, coupling: Gear | Coupling) -> Coupling:
    """Return a coupling, or that of a gear pair."""
    if isinstance(coupling, Coupling):
        return coupling
    terms, teeth = (coupling.phase, coupling.ratio), coupling.pressure_angle
    return Coupling(name, coupling.driven, coupling.driver, terms, turns=True, pressure_angle=teeth)


def _coupling(
    coordinates: FileCoordinates, name: str, table: Mapping[str, Any], path: KeyPath
) -> Gear | Coupling:
    kind_keys = [key for key in _KEYS_OF_KIND if key in table]
    if len(kind_keys) != 1:
        has = " and ".join(kind_keys) or "none"
        reason = (
            f"has {has} of ratio (a gear), radius or travel (a rack), coefficients (a polynomial), function, "
            "radii (a belt), rope; give one"
        )
        raise coordinates.error(path, reason)
    (kind,) = kind_keys
    opens = ("restitution",) if {"rope", "backlash"} & {*table} else ()
    play = () if kind == "rope" else ("backlash",)
    allowed = ("driver", "driven", kind, *_KEYS_OF_KIND[kind], *play, *opens)
    if extra := [key for key in table if key not in allowed]:
        raise coordinates.error((*path, extra[0]), f"does not go with {kind!r}; leave it out")
    for side in ("driver", "driven"):
        side_value = table.get(side, {})
        for coordinate in (side_value,) if isinstance(side_value, str) else side_value:
            coordinates.require(coordinate, (*path, side))
    if kind == "rope":
        return _rope(coordinates, name, table, path)
    if "driven" not in table:
        raise coordinates.error(path, "has no 'driven'; name a coordinate")
    if kind == "coefficients":
        return _polynomial(coordinates, name, table, path)
    if kind == "function":
        pair = _zeros(coordinates, table, path)
        made = _function(coordinates, table, path)
        driven, driver = table["driven"], table.get("driver", {})
        return Coupling(name, driven, driver, (), pair, table.get("turns", False), function=made)
    driver, driven = (_single_coordinate(coordinates, table, side, path) for side in ("driver", "driven"))
    phase = coordinates.value(driven, table.get("phase", 0.0), (*path, "phase"))
    made = {"radii": _belt, "ratio": _gear}.get(kind, _rack)
    return made(coordinates, name, table, path, (driver, driven, phase))


def _gear(
    coordinates: FileCoordinates,
    name: str,
    table: Mapping[str, Any],
    path: KeyPath,
    sides: tuple[str, str, float],
) -> Gear | Coupling:
    driver, driven, phase = sides
    unit, teeth = coordinates.units[driver], table.get("pressure_angle")
    if unit != coordinates.units[driven]:
        raise coordinates.error(path, "is between an angle and a displacement; give radius or travel")
    if KINDS[coordinates.kinds[driver]].hinge and KINDS[coordinates.kinds[driven]].hinge:
        return Gear(driver, driven, table["ratio"], phase, teeth or 0.0)
    turns = unit == "rad"
    return Coupling(name, driven, driver, (phase, table["ratio"]), turns=turns, pressure_angle=teeth)


def _rack(
    coordinates: FileCoordinates,
    name: str,
    table: Mapping[str, Any],
    path: KeyPath,
    sides: tuple[str, str, float],
) -> Coupling:
    """Return a rack and pinion: a displacement is the angle times the radius."""
    driver, driven, phase = sides
    units = coordinates.units[driver], coordinates.units[driven]
    if units[0] == units[1]:
        raise coordinates.error(
            path, "is a rack between two coordinates of one unit; give an angle and a displacement"
        )
    radius = table["radius"] if "radius" in table else table["travel"] / REVOLUTION
    if radius == 0.0:
        key = "radius" if "radius" in table else "travel"
        raise coordinates.error((*path, key), "is 0; give a length, negative for the opposite direction")
    ratio = radius if units[0] == "rad" else 1.0 / radius
    return Coupling(name, driven, driver, (phase, ratio), pressure_angle=table.get("pressure_angle", 0.0))


def _single_coordinate(
    coordinates: FileCoordinates, table: Mapping[str, Any], side: str, path: KeyPath
) -> str:
    """Return the single coordinate of a side."""
    value = table.get(side)
    if value is None:
        raise coordinates.error(path, f"has no {side!r}; name a coordinate")
    if not isinstance(value, str):
        reason = "is no single coordinate; name one, or give coefficients, which couple sums"
        raise coordinates.error((*path, side), reason)
    return value


def _polynomial(coordinates: FileCoordinates, name: str, table: Mapping[str, Any], path: KeyPath) -> Coupling:
    values = coordinates.values
    driven: Side = table["driven"]
    driver: Side = table.get("driver", {})
    factor, right = (_unit_factor(coordinates, side) for side in (driven, driver))
    coefficients: list[float] = []
    for power, written in enumerate(table["coefficients"]):
        entry_path = (*path, "coefficients", power)
        if power == 0 and isinstance(driven, str):
            coefficients.append(coordinates.value(driven, written, entry_path))
        else:
            coefficients.append(values.plain_number(written, entry_path) * (factor / right**power))
    pair, turns = _zeros(coordinates, table, path), table.get("turns", False)
    return Coupling(name, driven, driver, tuple(coefficients), pair, turns, table.get("pressure_angle"))


def _zeros(coordinates: FileCoordinates, table: Mapping[str, Any], path: KeyPath) -> tuple[float, float]:
    written = zip((table["driven"], table.get("driver", {})), table.get("zeros", (0.0, 0.0)), strict=True)
    first, second = (
        _zero(coordinates, side, value, (*path, "zeros", i)) for i, (side, value) in enumerate(written)
    )
    return first, second


def _function(coordinates: FileCoordinates, table: Mapping[str, Any], path: KeyPath) -> PlainFunction:
    """Return the function of a coupling: an expression of q and the file's parameters, or a table."""
    text, values = table["function"], coordinates.values
    if not table.get("driver"):
        raise coordinates.error(path, "is a function without a driver; name the coordinate q")
    if not is_table(text):
        return written_function(values, text, (*path, "function"))
    columns = read(values.source.sibling(text))
    if set(columns) != {"q", "value"}:
        raise coordinates.error((*path, "function"), f"has columns {', '.join(columns)}; give q and value")
    positions, targets = (tuple(columns[name].tolist()) for name in ("q", "value"))
    return TabledFunction(str(values.source.sibling(text)), positions, targets, table.get("periodic", False))


def _rope(coordinates: FileCoordinates, name: str, table: Mapping[str, Any], path: KeyPath) -> Coupling:
    """Return a rope: the sum of its path's changes is its length less the path at zero (Nikravesh, ch. 4).

    Raises:
        InputError: for unknown coordinates, or a rope that is slack where all its coordinates are stated.
    """
    weights = dict[str, float]()
    for coordinate, written in table["rope"].items():
        where = (*path, "rope", coordinate)
        coordinates.require(coordinate, (*path, "rope"))
        unit = "m" if coordinates.units[coordinate] == "rad" else "1"
        weights[coordinate] = coordinates.values.quantity(written, unit, where)
    if not any(weights.values()):
        raise coordinates.error(
            (*path, "rope"), "changes with no coordinate; give the change of its path per coordinate"
        )
    length, free = table.get("length", 0.0), table.get("path", 0.0)
    start = {
        key: coordinates.value(key, written, where) for key, (where, written) in _started(coordinates).items()
    }
    if start.keys() >= weights.keys():
        taut = free + sum(weight * start[key] for key, weight in weights.items())
        if not length <= taut + SLACK * max(abs(length), abs(taut)):
            reason = (
                f"is a rope of {length:g} m on a path of {taut:g} m: it is slack at the start; shorten it"
            )
            raise coordinates.error(path, reason)
    return Coupling(name, weights, {}, (length - free,), rope=True)


def _started(coordinates: FileCoordinates) -> dict[str, tuple[KeyPath, Any]]:
    """Return the coordinates that `start` states by name."""
    return coordinates.table("start") if isinstance(coordinates.read.get("start"), dict) else {}


def _belt(
    coordinates: FileCoordinates,
    name: str,
    table: Mapping[str, Any],
    path: KeyPath,
    sides: tuple[str, str, float],
) -> Coupling:
    """Return a belt or chain: angles with the ratio of the radii, opposite if it is crossed."""
    driver, driven, phase = sides
    if "m" in (coordinates.units[driver], coordinates.units[driven]):
        raise coordinates.error(path, "is a belt between coordinates that are no angles; name two rotations")
    if not min(table["radii"]) > 0.0:
        raise coordinates.error((*path, "radii"), "is no pair of radii above 0; give driver and driven")
    ratio = table["radii"][0] / table["radii"][1] * (-1.0 if table.get("crossed") else 1.0)
    pulley = table.get("tensioner", {"at": None, "radius": 0.0})
    if pulley["at"] and not pulley["radius"] > 0.0:
        raise coordinates.error((*path, "tensioner", "radius"), "is no radius above 0; enlarge it")
    belt = Belt(tuple(table["radii"]), table.get("length", 0.0), pulley["at"], pulley["radius"])
    return Coupling(name, driven, driver, (phase, ratio), turns=True, belt=belt)


def _zero(coordinates: FileCoordinates, side: Side, written: Any, path: KeyPath) -> float:
    if isinstance(side, str):
        return coordinates.value(side, written, path)
    units: list[Unit] = [coordinates.units[name] for name in side]
    return coordinates.values.quantity(written, units[0] if units else "m", path)


def _unit_factor(coordinates: FileCoordinates, side: Side) -> float:
    """Return the value in SI of the number 1 on a side; a sum of lengths and angles is in SI."""
    factors = {coordinates.unit_in_si(name) for name in ((side,) if isinstance(side, str) else side)}
    return factors.pop() if len(factors) == 1 else 1.0
