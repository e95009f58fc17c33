"""A mechanism as its TOML file describes it: links, joint frames, couplings, masses; all in SI."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpmath import mp, mpf

from exact.numbers import angle_unit, length_unit, motion_law, value

GROUND = "ground"


def cross(a: Any, b: Any) -> Any:
    """Return the vector product of two vectors (3,)."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


@dataclass(frozen=True)
class Side:
    """Joint on a link: point (3,) in [m] and frame (3, 3) of reference, axis x reference, axis."""

    link: str
    point: Any
    frame: Any


@dataclass(frozen=True)
class Pair:
    """A joint of two links."""

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
    """All that a file states; `motion_laws`: driver -> function of time."""

    name: str
    links: tuple[str, ...]
    bodies: dict[str, Body]
    pairs: tuple[Pair, ...]
    mates: tuple[Mate, ...]
    drivers: tuple[str, ...]
    start: dict[str, Any]
    points: dict[str, tuple[str, Any]]
    guess: dict[str, tuple[Any, Any]]
    motion_laws: dict[str, Any]
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
        """Return a number in the file's units."""
        return value(text, self.names, self.angle)

    def vector(self, entry: Any, scale: Any = 1) -> Any:
        """Return three numbers times a unit."""
        return np.array([self.number(item) * scale for item in entry], dtype=object)

    def side(self, entry: dict[str, Any]) -> Side:
        """Return one side of a joint."""
        axis = unit(self.vector(entry.get("axis", [0, 0, 1])))
        reference = entry.get("reference") or ([1, 0, 0] if abs(axis[0]) < mpf("0.9") else [0, 1, 0])
        reference = self.vector(reference)
        reference = unit(reference - axis * (axis @ reference))
        point = self.vector(entry.get("at", [0, 0, 0]), self.length)
        return Side(entry["link"], point, np.column_stack([reference, cross(axis, reference), axis]))

    def mate(self, entry: dict[str, Any]) -> Mate:
        """Return a coupling by its keys: a gear's ratio, or the radius of a rack's pinion."""
        if "radius" in entry:
            ratio = self.number(entry["radius"]) * self.length
        elif "ratio" in entry:
            ratio = self.number(entry["ratio"])
        else:
            raise ValueError(f"a coupling by {', '.join(entry)} is not known here")
        return Mate(entry["driver"], entry["driven"], ratio, self.number(entry.get("phase", 0)) * self.angle)

    def body(self, entry: dict[str, Any]) -> Body:
        """Return a link's inertia; masses and moments stand in SI."""
        stated = entry["inertia"]
        moments = np.diag(self.vector(stated["moments"]))
        return Body(self.number(stated["mass"]), self.vector(stated["centre"], self.length), moments)

    def pose(self, entry: dict[str, Any]) -> tuple[Any, Any]:
        """Return an approximate position and rotation."""
        position = self.vector(entry.get("at", [0, 0, 0]), self.length)
        if "rotation" in entry:
            return position, np.array([self.vector(row) for row in entry["rotation"]], dtype=object)
        axis_angle = entry.get("turn", {"axis": [0, 0, 1], "angle": 0})
        return position, rotation(
            unit(self.vector(axis_angle["axis"])), self.number(axis_angle["angle"]) * self.angle
        )


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
        Pair(name, item["kind"], reader.side(item["a"]), reader.side(item["b"]))
        for name, item in raw["joints"].items()
    )
    links = dict.fromkeys(side.link for pair in pairs for side in (pair.a, pair.b) if side.link != GROUND)
    drivers = tuple(raw.get("drivers", ["crank"]))
    entry = raw.get("start", 0)
    start = entry if isinstance(entry, dict) else dict.fromkeys(drivers, entry)
    slides = {pair.name for pair in pairs if pair.kind == "prismatic"}
    scale = {name: reader.length if name in slides else reader.angle for name in drivers}
    return Description(
        name=raw["name"],
        links=tuple(links),
        bodies={name: reader.body(raw["links"][name]) for name in links},
        pairs=pairs,
        mates=tuple(reader.mate(item) for item in raw.get("couplings", {}).values()),
        drivers=drivers,
        start={name: reader.number(start[name]) * scale[name] for name in drivers},
        points={
            name: (item["link"], reader.vector(item.get("at", [0, 0, 0]), reader.length))
            for name, item in raw["points"].items()
        },
        guess={name: reader.pose(item) for name, item in raw.get("guess", {}).items()},
        motion_laws={name: motion_law(law, reader.names) for name, law in raw.get("motion_laws", {}).items()},
        gravity=reader.vector(raw["forces"]["gravity"]),
    )
