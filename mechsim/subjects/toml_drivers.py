"""What a TOML file says is driven, how, from where, and what is held."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mechsim import files
from mechsim.errors import InputError
from mechsim.model.joint_kinds import KINDS, KindName, kinds_that
from mechsim.subjects.checked_values import Values
from mechsim.subjects.key_types import Number
from mechsim.subjects.motion_law_text import MotionLaw, Start, parse_motion_law
from mechsim.subjects.toml_source import KeyPath, suggestion
from mechsim.units import Unit

# what a joint is driven by where no driver is named
CRANK = "crank"


@dataclass(frozen=True)
class FileCoordinates:
    """The coordinates of a file's joints, by which it names drivers, holds and couplings.

    Attributes:
        values: what reads the file's numbers.
        kinds: coordinate -> kind of its joint.
        units: coordinate -> "m" or "rad".
    """

    values: Values
    kinds: Mapping[str, KindName]
    units: Mapping[str, Unit]

    def require(self, name: str, path: KeyPath) -> None:
        """Refuse what is no coordinate."""
        if name not in self.units:
            raise self.values.source.error(path, f"names coordinate {name!r}{suggestion(name, self.units)}")

    def value(self, name: str, written: Any, path: KeyPath) -> float:
        """Return the value of a coordinate in SI."""
        self.require(name, path)
        return self.values.checked(Number(self.units[name], ""), written, path)

    def unit_in_si(self, name: str) -> float:
        """Return what a bare number of a coordinate counts, in SI."""
        return self.values.in_si(1.0, self.units[name])

    def table(self, read: Mapping[str, Any], key: str) -> dict[str, tuple[KeyPath, Any]]:
        """Return a table by coordinates: name -> its place in the file, and its value."""
        entries: dict[str, tuple[KeyPath, Any]] = {}
        for name, value_ in read.get(key, {}).items():
            components = value_ if isinstance(value_, dict) else {"": value_}
            for suffix, value in components.items():
                coordinate = f"{name}.{suffix}" if suffix else name
                path = (key, name, suffix) if suffix else (key, name)
                self.require(coordinate, path)
                entries[coordinate] = path, value
        return entries


def coordinates_of(values: Values, joints: Mapping[str, Any]) -> FileCoordinates:
    """Return the coordinates of joints as read."""
    kinds: dict[str, KindName] = {}
    units: dict[str, Unit] = {}
    for name, table in joints.items():
        kind = KINDS[table["kind"]]
        for ending, unit in zip(kind.endings, kind.units, strict=True):
            kinds[name + ending] = table["kind"]
            units[name + ending] = "m" if unit == "m" else "rad"
    return FileCoordinates(values, kinds, units)


def drivers_of(
    coordinates: FileCoordinates, read: Mapping[str, Any], requested: tuple[str, ...]
) -> str | tuple[str, ...]:
    """Return what is driven: what the file names, else what is asked, else the joint called crank."""
    only_crank = "drivers" not in read and CRANK in read["joints"]
    drivers = read.get("drivers") or requested or ((CRANK,) if only_crank else ())
    if not drivers:
        raise InputError('no joint is driven; add drivers = ["NAME OF A JOINT"], or --drive JOINT=PROGRAM')
    for name in drivers:
        coordinates.require(name, ("drivers",))
        kind = coordinates.kinds[name]
        if not KINDS[kind].drivable:  # pyright: ignore[reportArgumentType]
            only = kinds_that(lambda kind_: kind_.drivable)
            reason = f"names {kind} joint {name!r}; only a {only} one can be driven"
            raise coordinates.values.source.error(("drivers",), reason)
    return drivers[0] if len(drivers) == 1 else tuple(drivers)


def start_of(
    coordinates: FileCoordinates, read: Mapping[str, Any], driver: str | tuple[str, ...]
) -> tuple[float, dict[str, float]]:
    """Return the crank angle of the guess in [rad], and what other coordinates are counted from."""
    stated = read.get("start", 0.0)
    crank = driver if isinstance(driver, str) and KINDS[coordinates.kinds[driver]].hinge else None
    if not isinstance(stated, dict):
        if not isinstance(driver, str):
            if "start" in read:
                names = ", ".join(driver)
                reason = f"is one number, but {names} are driven; give a table, {{ {driver[0]} = ... }}"
                raise coordinates.values.source.error(("start",), reason)
            return 0.0, {}
        value = coordinates.value(driver, stated, ("start",))
        return (value, {}) if crank is not None or "start" not in read else (0.0, {driver: value})
    values = {
        name: coordinates.value(name, value_, path)
        for name, (path, value_) in coordinates.table(read, "start").items()
    }
    return values.pop(crank, 0.0) if crank is not None else 0.0, values


def locked_of(
    coordinates: FileCoordinates, read: Mapping[str, Any], driver: str | tuple[str, ...]
) -> dict[str, float]:
    """Return the coordinates held, and where in SI."""
    locked: dict[str, float] = {}
    for name, (path, value) in coordinates.table(read, "locked").items():
        if name in ((driver,) if isinstance(driver, str) else driver):
            raise coordinates.values.source.error(path, "is driven; hold it, or drive it")
        locked[name] = coordinates.value(name, value, path)
    return locked


@dataclass(frozen=True)
class FileMotionLaw:
    """A program as a file has it: numbers without a unit are in the file's, and parameters have names.

    Attributes:
        coordinates: the file's coordinates.
        text: as it is written.
        path: where.
    """

    coordinates: FileCoordinates
    text: str
    path: KeyPath

    def parse(self, name: str, unit: str, start: Start) -> MotionLaw:
        """Return the program; as `motion_law_text.parse_motion_law`."""
        values = self.coordinates.values
        text = self.text
        if text.strip().lower().endswith(files.EXTENSIONS):
            text = values.source.sibling(text)
        with values.source.error_context(self.path):
            return parse_motion_law(
                text,
                name,
                unit,
                start,
                default_unit=self.coordinates.unit_in_si(name),
                parameters=values.parameters,
            )


def motion_laws_of(
    coordinates: FileCoordinates, read: Mapping[str, Any], driver: str | tuple[str, ...]
) -> dict[str, FileMotionLaw]:
    """Return the programs of a file's drivers."""
    drivers = (driver,) if isinstance(driver, str) else driver
    laws: dict[str, FileMotionLaw] = {}
    for name, (path, text) in coordinates.table(read, "programs").items():
        if name not in drivers:
            raise coordinates.values.source.error(path, f"is not driven; drivers are {', '.join(drivers)}")
        laws[name] = FileMotionLaw(coordinates, text, path)
    return laws
