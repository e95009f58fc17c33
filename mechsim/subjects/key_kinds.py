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
class Word:
    """Text; one of some words where they are listed."""

    about: str
    options: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Amount:
    """A number as `Number`, of a unit that only a joint tells."""

    about: str


@dataclass(frozen=True, slots=True)
class Course:
    """A number as `Number`, or text that says how it goes over t or the crank's angle, or FILE.csv."""

    unit: Unit
    about: str


@dataclass(frozen=True, slots=True)
class Truth:
    """true or false."""

    about: str


@dataclass(frozen=True, slots=True)
class Several:
    """A list; of so many where that is known."""

    of: "Key"
    about: str
    count: int | None = None


@dataclass(frozen=True, slots=True)
class Named:
    """A table of things under names of the user's own."""

    of: "Key"
    about: str


@dataclass(frozen=True, slots=True)
class Keys:
    """A table with keys of its own."""

    keys: Mapping[str, "Key"]
    about: str
    required: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Choice:
    """Whichever fits by its form: text, a number, a list or a table."""

    of: tuple["Key", ...]
    about: str


Key = Number | Amount | Course | Word | Truth | Several | Named | Keys | Choice


def vector(unit: Unit, about: str) -> Several:
    """Return the key of three numbers."""
    return Several(Number(unit, "a component"), about, 3)


def by_coordinate(of: Key, about: str) -> Named:
    """Return the key of a table by coordinates: `joint`, or `joint.way` and `joint.turn`."""
    return Named(Choice((of, Named(of, "of a joint with several coordinates")), of.about), about)
