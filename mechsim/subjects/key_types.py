"""What a key of a TOML file may hold: plain data by which files are checked and the schema is made."""

from collections.abc import Mapping
from dataclasses import dataclass

from mechsim.units import Unit


@dataclass(frozen=True, slots=True)
class Number:
    """A number, text with a unit, or an expression."""

    unit: Unit
    about: str


@dataclass(frozen=True, slots=True)
class Text:
    """Text; one of some words where they are listed."""

    about: str
    options: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class JointNumber:
    """A number as `Number`, of a unit that only a joint tells."""

    about: str


@dataclass(frozen=True, slots=True)
class Profile:
    """A number as `Number`, or text that says how it goes over t or the crank's angle, or FILE.csv."""

    unit: Unit
    about: str


@dataclass(frozen=True, slots=True)
class Boolean:
    """true or false."""

    about: str


@dataclass(frozen=True, slots=True)
class ListOf:
    """A list; of so many where that is known."""

    item: "KeyType"
    about: str
    count: int | None = None


@dataclass(frozen=True, slots=True)
class TableOf:
    """A table of things under names of the user's own."""

    value_type: "KeyType"
    about: str


@dataclass(frozen=True, slots=True)
class Table:
    """A table with keys of its own."""

    keys: Mapping[str, "KeyType"]
    about: str
    required: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class AnyOf:
    """Whichever fits by its form: text, a number, a list or a table."""

    alternatives: tuple["KeyType", ...]
    about: str


KeyType = Number | JointNumber | Profile | Text | Boolean | ListOf | TableOf | Table | AnyOf


def vector(unit: Unit, about: str) -> ListOf:
    """Return the key of three numbers."""
    return ListOf(Number(unit, "a component"), about, 3)


def by_coordinate(value_type: KeyType, about: str) -> TableOf:
    """Return the key of a table by coordinates: `joint`, or `joint.way` and `joint.turn`."""
    return TableOf(
        AnyOf((value_type, TableOf(value_type, "of a joint with several coordinates")), value_type.about),
        about,
    )
