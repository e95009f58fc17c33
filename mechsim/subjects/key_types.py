"""Types of values in a TOML file. The reader checks files by them; the JSON Schema is made from them."""

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
    """A number as `Number`; its unit follows from the joint."""

    about: str


@dataclass(frozen=True, slots=True)
class Profile:
    """A number as `Number`, or a function of t or the crank angle: an expression, or FILE.csv."""

    unit: Unit
    about: str


@dataclass(frozen=True, slots=True)
class Boolean:
    """true or false."""

    about: str


@dataclass(frozen=True, slots=True)
class ListOf:
    """A list, of fixed length if `count` is given."""

    item: "KeyType"
    about: str
    count: int | None = None


@dataclass(frozen=True, slots=True)
class TableOf:
    """A table whose keys are names chosen by the user."""

    value_type: "KeyType"
    about: str


@dataclass(frozen=True, slots=True)
class Table:
    """A table with fixed keys."""

    keys: Mapping[str, "KeyType"]
    about: str
    required: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class AnyOf:
    """The first alternative that fits the value: text, a number, a list or a table."""

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
