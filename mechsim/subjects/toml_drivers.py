"""What a TOML file says is driven, how, from where, and what is held."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mechsim import files
from mechsim.errors import InputError
from mechsim.model.joint_kinds import KINDS, KindName, kinds_that
from mechsim.subjects.checked_values import Values
from mechsim.subjects.key_kinds import Number
from mechsim.subjects.program_text import Program, Start, program
from mechsim.subjects.toml_source import KeyPath, nearest
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
            raise self.values.source.refusal(path, f"names coordinate {name!r}{nearest(name, self.units)}")

    def value(self, name: str, written: Any, path: KeyPath) -> float:
        """Return the value of a coordinate in SI."""
        self.require(name, path)
        return self.values.checked(Number(self.units[name], ""), written, path)

    def unit_in_si(self, name: str) -> float:
        """Return what a bare number of a coordinate counts, in SI."""
        return self.values.in_si(1.0, self.units[name])

    def table(self, read: Mapping[str, Any], key: str) -> dict[str, tuple[KeyPath, Any]]:
        """Return a table by coordinates: name -> its place in the file, and its value."""
        found: dict[str, tuple[KeyPath, Any]] = {}
        for name, one in read.get(key, {}).items():
            parts = one if isinstance(one, dict) else {"": one}
            for part, value in parts.items():
                whole = f"{name}.{part}" if part else name
                path = (key, name, part) if part else (key, name)
                self.require(whole, path)
                found[whole] = path, value
        return found


def coordinates_of(values: Values, joints: Mapping[str, Any]) -> FileCoordinates:
    """Return the coordinates of joints as read."""
    kinds: dict[str, KindName] = {}
    units: dict[str, Unit] = {}
    for name, one in joints.items():
        kind = KINDS[one["kind"]]
        for ending, unit in zip(kind.endings, kind.units, strict=True):
            kinds[name + ending] = one["kind"]
            units[name + ending] = "m" if unit == "m" else "rad"
    return FileCoordinates(values, kinds, units)


def drivers_of(of: FileCoordinates, read: Mapping[str, Any], asked: tuple[str, ...]) -> str | tuple[str, ...]:
    """Return what is driven: what the file names, else what is asked, else the joint called crank."""
    alone = "drivers" not in read and CRANK in read["joints"]
    drivers = read.get("drivers") or asked or ((CRANK,) if alone else ())
    if not drivers:
        raise InputError('no joint is driven; add drivers = ["NAME OF A JOINT"], or --drive JOINT=PROGRAM')
    for name in drivers:
        of.require(name, ("drivers",))
        kind = of.kinds[name]
        if not KINDS[kind].drivable:  # pyright: ignore[reportArgumentType]
            only = kinds_that(lambda one: one.drivable)
            why = f"names {kind} joint {name!r}; only a {only} one can be driven"
            raise of.values.source.refusal(("drivers",), why)
    return drivers[0] if len(drivers) == 1 else tuple(drivers)


def start_of(
    of: FileCoordinates, read: Mapping[str, Any], driver: str | tuple[str, ...]
) -> tuple[float, dict[str, float]]:
    """Return the crank angle of the guess in [rad], and what other coordinates are counted from."""
    given = read.get("start", 0.0)
    crank = driver if isinstance(driver, str) and KINDS[of.kinds[driver]].hinge else None
    if not isinstance(given, dict):
        if not isinstance(driver, str):
            if "start" in read:
                names = ", ".join(driver)
                why = f"is one number, but {names} are driven; give a table, {{ {driver[0]} = ... }}"
                raise of.values.source.refusal(("start",), why)
            return 0.0, {}
        value = of.value(driver, given, ("start",))
        return (value, {}) if crank is not None or "start" not in read else (0.0, {driver: value})
    found = {name: of.value(name, one, path) for name, (path, one) in of.table(read, "start").items()}
    return found.pop(crank, 0.0) if crank is not None else 0.0, found


def locked_of(
    of: FileCoordinates, read: Mapping[str, Any], driver: str | tuple[str, ...]
) -> dict[str, float]:
    """Return the coordinates held, and where in SI."""
    found: dict[str, float] = {}
    for name, (path, one) in of.table(read, "locked").items():
        if name in ((driver,) if isinstance(driver, str) else driver):
            raise of.values.source.refusal(path, "is driven; hold it, or drive it")
        found[name] = of.value(name, one, path)
    return found


@dataclass(frozen=True)
class FileProgram:
    """A program as a file has it: numbers without a unit are in the file's, and parameters have names.

    Attributes:
        of: the file's coordinates.
        text: as it is written.
        path: where.
    """

    of: FileCoordinates
    text: str
    path: KeyPath

    def made(self, name: str, unit: str, start: Start) -> Program:
        """Return the program; as `program_text.program`."""
        values = self.of.values
        text = self.text
        if text.strip().lower().endswith(files.EXTENSIONS):
            text = values.source.beside(text)
        with values.source.about(self.path):
            return program(text, name, unit, start, bare=self.of.unit_in_si(name), names=values.parameters)


def programs_of(
    of: FileCoordinates, read: Mapping[str, Any], driver: str | tuple[str, ...]
) -> dict[str, FileProgram]:
    """Return the programs of a file's drivers."""
    drivers = (driver,) if isinstance(driver, str) else driver
    found: dict[str, FileProgram] = {}
    for name, (path, text) in of.table(read, "programs").items():
        if name not in drivers:
            raise of.values.source.refusal(path, f"is not driven; drivers are {', '.join(drivers)}")
        found[name] = FileProgram(of, text, path)
    return found
