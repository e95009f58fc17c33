"""A mechanism as its TOML file describes it: links, joint frames, couplings, masses; all in SI."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpmath import mp, mpf

from exact.numbers import angle_unit, length_unit, program, value

GROUND = "ground"


def cross(a: Any, b: Any) -> Any:
    """Return the vector product of two vectors (3,)."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@dataclass(frozen=True)
class Side:
    """Where a joint lies on a link: point (3,) in [m] and frame (3, 3), columns mark, axis x mark, axis."""

    link: str
    point: Any
    frame: Any


@dataclass(frozen=True)
class Pair:
    """Two links that meet."""

    name: str
    kind: str
    a: Side
    b: Side


@dataclass(frozen=True)
class Mate:
    """A coupling: driven = phase + ratio driver, in [rad] or [m]."""

    driver: str
    driven: str
    ratio: Any
    phase: Any


@dataclass(frozen=True)
class Body:
    """Mass in [kg], its centre in the link's frame in [m], moments about it in [kg m2]."""

    mass: Any
    centre: Any
    moments: Any


@dataclass(frozen=True)
class Description:
    """All that a file says; `programs` by driver are functions of time."""

    name: str
    links: tuple[str, ...]
    bodies: dict[str, Body]
    pairs: tuple[Pair, ...]
    mates: tuple[Mate, ...]
    drivers: tuple[str, ...]
    start: dict[str, Any]
    points: dict[str, tuple[str, Any]]
    guess: dict[str, tuple[Any, Any]]
    programs: dict[str, Any]
    gravity: Any


class Reader:
    """Reads one file at the working precision."""

    def __init__(self, path: Path) -> None:
        self.raw = tomllib.loads(path.read_text(encoding="utf-8"), parse_float=str)
        units = self.raw.get("units", {})
        self.length = length_unit(units.get("length", "m"))
        self.angle = angle_unit(units.get("angle", "rad"))
        self.names: dict[str, Any] = {}
        for name, text in self.raw.get("parameters", {}).items():
            self.names[name] = self.number(text)

    def number(self, text: Any) -> Any:
        """Return a number as it stands, in the file's units."""
        return value(text, self.names, self.angle)

    def vector(self, given: Any, scale: Any = 1) -> Any:
        """Return three numbers times a unit."""
        return np.array([self.number(one) * scale for one in given], dtype=object)

    def side(self, given: dict[str, Any]) -> Side:
        """Return one side of a joint."""
        axis = unit(self.vector(given.get("axis", [0, 0, 1])))
        mark = given.get("mark") or ([1, 0, 0] if abs(axis[0]) < mpf("0.9") else [0, 1, 0])
        mark = self.vector(mark)
        mark = unit(mark - axis * (axis @ mark))
        point = self.vector(given.get("at", [0, 0, 0]), self.length)
        return Side(given["link"], point, np.column_stack([mark, cross(axis, mark), axis]))

    def mate(self, given: dict[str, Any]) -> Mate:
        """Return a coupling told by its keys: a gear's ratio, or the radius of a rack's pinion."""
        if "radius" in given:
            ratio = self.number(given["radius"]) * self.length
        elif "ratio" in given:
            ratio = self.number(given["ratio"])
        else:
            raise ValueError(f"a coupling by {', '.join(given)} is not known here")
        return Mate(given["driver"], given["driven"], ratio, self.number(given.get("phase", 0)) * self.angle)

    def body(self, given: dict[str, Any]) -> Body:
        """Return a link's inertia; masses and moments stand in SI."""
        told = given["inertia"]
        moments = np.diag(self.vector(told["moments"]))
        return Body(self.number(told["mass"]), self.vector(told["centre"], self.length), moments)

    def pose(self, given: dict[str, Any]) -> tuple[Any, Any]:
        """Return a rough place and attitude."""
        place = self.vector(given.get("at", [0, 0, 0]), self.length)
        if "rotation" in given:
            return place, np.array([self.vector(row) for row in given["rotation"]], dtype=object)
        turn = given.get("turn", {"axis": [0, 0, 1], "angle": 0})
        return place, rotation(unit(self.vector(turn["axis"])), self.number(turn["angle"]) * self.angle)


def unit(vector: Any) -> Any:
    """Return a vector made as long as 1."""
    return vector / mp.sqrt(vector @ vector)


def rotation(axis: Any, angle: Any) -> Any:
    """Return the rotation about a unit vector by an angle in [rad]; Rodrigues."""
    c, s = mp.cos(angle), mp.sin(angle)
    across = np.array([cross(axis, column) for column in np.eye(3, dtype=int)]).T
    return c * np.eye(3, dtype=int) + s * across + (1 - c) * np.outer(axis, axis)


def read(path: Path) -> Description:
    """Return the mechanism of a TOML file at the working precision."""
    reader = Reader(path)
    raw = reader.raw
    pairs = tuple(
        Pair(name, one["kind"], reader.side(one["a"]), reader.side(one["b"]))
        for name, one in raw["joints"].items()
    )
    links = dict.fromkeys(side.link for pair in pairs for side in (pair.a, pair.b) if side.link != GROUND)
    drivers = tuple(raw.get("drivers", ["crank"]))
    given = raw.get("start", 0)
    start = given if isinstance(given, dict) else dict.fromkeys(drivers, given)
    slides = {pair.name for pair in pairs if pair.kind == "prismatic"}
    scale = {name: reader.length if name in slides else reader.angle for name in drivers}
    return Description(
        name=raw["name"],
        links=tuple(links),
        bodies={name: reader.body(raw["links"][name]) for name in links},
        pairs=pairs,
        mates=tuple(reader.mate(one) for one in raw.get("couplings", {}).values()),
        drivers=drivers,
        start={name: reader.number(start[name]) * scale[name] for name in drivers},
        points={
            name: (one["link"], reader.vector(one.get("at", [0, 0, 0]), reader.length))
            for name, one in raw["points"].items()
        },
        guess={name: reader.pose(one) for name, one in raw.get("guess", {}).items()},
        programs={name: program(text, reader.names) for name, text in raw.get("programs", {}).items()},
        gravity=reader.vector(raw["forces"]["gravity"]),
    )
