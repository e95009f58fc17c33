"""The keys of a mechanism in TOML: what the reader checks by and `mechsim schema` is made from."""

from collections.abc import Mapping
from dataclasses import dataclass

from mechsim.model.joints import KINDS
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


Key = Number | Word | Several | Named | Keys | Choice


def _vector(unit: Unit, about: str) -> Several:
    return Several(Number(unit, "a component"), about, 3)


PLACE = Choice(
    (
        Word("name of a point"),
        Keys(
            {"link": Word("name of a link, or ground"), "at": _vector("m", "in the link's frame")},
            "a place on a link",
            ("link",),
        ),
    ),
    "name of a point, or link and place in its frame",
)
_MOMENT = Several(Number("kg m^2", "a moment of inertia"), "a row of the matrix", 3)
_END = Keys(
    {
        "link": Word("name of a link, or ground"),
        "at": _vector("m", "where the joint is, in the link's frame; the origin if left out"),
        "axis": _vector("1", "direction of the joint's axis in the link's frame; z if left out"),
        "mark": _vector("1", "direction across the axis from which the angle is counted; x if left out"),
    },
    "one side of the joint",
    ("link",),
)
_LINK = Keys(
    {
        "outline": Several(_vector("m", "a point"), "points in the link's frame that a picture joins up"),
        "inertia": Keys(
            {
                "mass": Number("kg", "mass"),
                "centre": _vector("m", "centre of mass in the link's frame"),
                "moments": Several(
                    Choice(
                        (Number("kg m^2", "a moment of inertia"), _MOMENT), "a moment of inertia, or three"
                    ),
                    "about the centre along the link's axes: three, or the matrix of three rows",
                    3,
                ),
            },
            "mass, centre and moments; a steel rod if left out",
            ("mass", "centre", "moments"),
        ),
    },
    "a moving link",
)
_JOINT = Keys(
    {
        "kind": Word("what it leaves free", tuple(KINDS)),
        "a": _END,
        "b": _END,
        "cross_angle": Number("rad", "between the axes of a universal joint; a right angle if left out"),
    },
    "a joint",
    ("kind", "a", "b"),
)
_COUPLING = Keys(
    {
        "driver": Word("name of a revolute joint"),
        "driven": Word("name of another"),
        "ratio": Number("1", "turns of the driven joint per turn of the driver"),
        "phase": Number("rad", "angle of the driven joint where the driver is at zero; 0 if left out"),
    },
    "driven = ratio * driver + phase",
    ("driver", "driven", "ratio"),
)
_GUESS = Keys(
    {
        "at": _vector("m", "of the link's origin"),
        "turn": Keys(
            {"axis": _vector("1", "to turn about"), "angle": Number("rad", "by how much")},
            "from the frame's axes to the link's",
            ("axis", "angle"),
        ),
        "rotation": Several(
            Several(Number("1", "a cosine"), "a row", 3), "the same as a matrix, instead of `turn`", 3
        ),
    },
    "roughly where a link is",
)

ROOT = Keys(
    {
        "name": Word("of the mechanism"),
        "units": Keys(
            {"length": Word("as in mm; m if left out"), "angle": Word("as in deg; rad if left out")},
            "of numbers without a unit of their own",
        ),
        "drivers": Several(Word("name of a revolute joint"), "the joint that is the crank", 1),
        "parameters": Named(
            Number("1", "a number, a quantity, or an expression of parameters before it"),
            "numbers used below by name, and changed by --set",
        ),
        "links": Named(_LINK, "moving links; one that several joints name needs no table"),
        "joints": Named(_JOINT, "joints"),
        "couplings": Named(_COUPLING, "gears between revolute joints"),
        "points": Named(
            Keys(
                {"link": Word("name of a link"), "at": _vector("m", "in the link's frame")},
                "a point",
                ("link",),
            ),
            "points whose motion is wanted",
        ),
        "start": Number("rad", "crank angle of the guess; 0 if left out"),
        "guess": Named(_GUESS, "which assembly is meant: rough places of links"),
        "formula": Keys(
            {"python": Word("FILE.py:FUNCTION, the user's own model of the motion")}, "an analytic model"
        ),
    },
    "a mechanism",
    ("name", "joints"),
)
