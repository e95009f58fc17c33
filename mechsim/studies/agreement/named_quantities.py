"""Names of what a formula or a table gives: P, P.v, P.xy, J, J.q, J.v, torque:J, force:J and the like."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Literal

import numpy as np

from mechsim.errors import InputError
from mechsim.model.joint_kinds import FIXED, KINDS
from mechsim.model.link_poses import plane_normals
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array

Kind = Literal[
    "position",
    "velocity",
    "acceleration",
    "joint",
    "joint rate",
    "joint acceleration",
    "torque",
    "force",
    "moment",
]
EFFORTS: dict[str, Kind] = {"torque": "torque", "force": "force", "moment": "moment"}
OF_POINT: dict[str, Kind] = {"": "position", "v": "velocity", "a": "acceleration"}
OF_JOINT: dict[str, Kind] = {"": "joint", "q": "joint", "v": "joint rate", "a": "joint acceleration"}
_ENDING = re.compile(r"(?P<rate>[qva]?)(?P<part>\d?)(?P<axes>[xyz]{0,3})")
_TURNED = re.compile(r"(?P<axes>[xyz]{1,3})(?P<rate>[va])")
AXES = "xyz"


@dataclass(frozen=True, slots=True)
class NamedQuantity:
    """A quantity of a subject.

    Attributes:
        name: as it was given.
        kind: what it is.
        subject: point, coordinate or joint.
        axes: ground axes of the components given, as "xyz", "xy" or "x"; empty for a number.
        unit: in SI.
    """

    name: str
    kind: Kind
    subject: str
    axes: str
    unit: str

    @property
    def angle(self) -> bool:
        """Whether whole turns of it do not count."""
        return self.kind == "joint" and self.unit == "rad"

    def components(self, vectors: Array) -> Array:
        """Return its components of vectors in ground axes (n, 3), or of numbers (n, 1): (n, k)."""
        return vectors[:, [AXES.index(axis) for axis in self.axes]] if self.axes else vectors


@dataclass(frozen=True)
class Names:
    """What the names of a mechanism's quantities are.

    Attributes:
        mechanism: whose.
        coordinates: coordinate -> its unit, "m" or "rad".
        plane: axes of a point given by two numbers; empty where nothing says which.
    """

    mechanism: Mechanism
    coordinates: Mapping[str, str]
    plane: str = ""

    def read(self, name: str, width: int | None, who: str) -> NamedQuantity:
        """Return the quantity that a name and the number of values at each instant mean.

        Args:
            name: as given.
            width: values at each instant; None for a single column (n,).
            who: gives it, for messages.

        Raises:
            InputError: for a name that is none, with the nearest one, or a width that does not fit.
        """
        effort, colon, rest = name.partition(":")
        if colon and effort in EFFORTS:
            return self._effort(name, EFFORTS[effort], rest, width, who)
        for subject, ending in _splits(name):
            rate, part, axes = _read_ending(ending)
            if rate is None:
                continue
            coordinate = self._coordinate(subject, part)
            scalar = not axes and (rate == "q" or part or width is None or width == 1)
            if coordinate is not None and scalar:
                unit = self.coordinates[coordinate]
                per = {"v": "/s", "a": "/s2"}.get(rate, "")
                return NamedQuantity(name, OF_JOINT[rate], coordinate, "", unit + per)
            if subject in self.mechanism.points and rate != "q" and not part:
                unit = "m" + {"v": "/s", "a": "/s2"}.get(rate, "")
                return NamedQuantity(name, OF_POINT[rate], subject, self._axes(name, axes, width, who), unit)
        raise InputError(
            f"{who} gives {name!r}, which is nothing of {self.mechanism.name}{self._nearest(name)}"
        )

    def _effort(self, name: str, kind: Kind, rest: str, width: int | None, who: str) -> NamedQuantity:
        joint, _, axes = rest.partition(".")
        if rest in self.coordinates or rest in {one.name for one in self.mechanism.joints}:
            joint, axes = rest, ""
        known = self._drives() if kind == "torque" else self._joints()
        if joint not in known or axes.strip(AXES):
            what = "drive" if kind == "torque" else "joint"
            raise InputError(
                f"{who} gives {name!r}, but {self.mechanism.name} has no {what} "
                f"{joint!r}{nearest(joint, known)}"
            )
        if kind == "torque":
            return NamedQuantity(name, kind, joint, "", "N" if self.coordinates.get(joint) == "m" else "N m")
        return NamedQuantity(
            name, kind, joint, self._axes(name, axes, width, who), "N" if kind == "force" else "N m"
        )

    def _drives(self) -> list[str]:
        return [*self.mechanism.drivers, *self.mechanism.locked]

    def _joints(self) -> list[str]:
        return [joint.name for joint in self.mechanism.joints]

    def _coordinate(self, subject: str, part: str) -> str | None:
        """Return the coordinate of a name, or of a joint's name and the number of a coordinate."""
        if not part:
            return subject if subject in self.coordinates else None
        joint = next((one for one in self.mechanism.joints if one.name == subject), None)
        if joint is None or int(part) >= len(joint.coordinates):
            return None
        coordinate = joint.coordinates[int(part)]
        return coordinate if coordinate in self.coordinates else None

    def _axes(self, name: str, axes: str, width: int | None, who: str) -> str:
        """Return of which ground axes so many values a point has are."""
        count = 1 if width is None else width
        if not axes:
            axes = AXES if count == 3 else self.plane if count == 2 else ""
        if len(axes) == count and len(set(axes)) == count:
            return axes
        if count == 2 and not axes:
            raise InputError(
                f"{who} gives {name!r} by two numbers, but {self.mechanism.name} does not move in a plane of "
                f"the ground's axes; name the plane, as in '{name}.xy'"
            )
        of = f"({len(axes)} axes: {axes})" if axes else "(n, 3), or (n, 2) in a plane"
        shape = "(n,)" if width is None else f"(n, {width})"
        raise InputError(f"{who} gives {name!r} of shape {shape}; give {of}")

    def _nearest(self, name: str) -> str:
        known = dict.fromkeys([*self.mechanism.points, *self.coordinates])
        return nearest(name.partition(".")[0].rpartition(":")[2], known)


def names_of(mechanism: Mechanism, plane: str = "") -> Names:
    """Return the names of a mechanism's quantities; points given by two numbers lie in a plane, as "xz".

    Raises:
        InputError: for a plane that is none.
    """
    units = {
        coordinate: unit
        for joint in mechanism.joints
        if joint.kind != FIXED
        for coordinate, unit in zip(joint.coordinates, KINDS[joint.kind].units, strict=False)
    }
    if plane and (len(plane) != 2 or len(set(plane)) != 2 or plane.strip(AXES)):
        raise InputError(f"the plane is {plane!r}; give two of the ground's axes, as in 'xy'")
    return Names(mechanism, units, plane or _own_plane(mechanism))


def _own_plane(mechanism: Mechanism) -> str:
    """Return the ground's axes of the plane in which a mechanism moves; empty where there is none."""
    normals = plane_normals(mechanism)
    if normals is None or GROUND not in normals:
        return ""
    along = np.flatnonzero(np.abs(normals[GROUND]) > 1.0 - 1e-9)
    return AXES.replace(AXES[int(along[0])], "") if len(along) else ""


def nearest(name: str, known: Iterable[str]) -> str:
    """Return the end of a refusal: what was probably meant, and what there is."""
    names = list(known)
    folded = {one.lower(): one for one in names}
    close = get_close_matches(name.lower(), folded, n=1)
    meant = f"; did you mean {folded[close[0]]!r}?" if close else ";"
    return f"{meant} there are {', '.join(names) or 'none'}"


def _splits(name: str) -> list[tuple[str, str]]:
    """Return what may be subject and ending of a name, the longest subject first."""
    parts = name.split(".")
    return [(".".join(parts[:i]), "".join(parts[i:])) for i in range(len(parts), 0, -1)]


def _read_ending(ending: str) -> tuple[str | None, str, str]:
    """Return rate (q, v, a or nothing), number of a coordinate and axes of an ending; None for no ending."""
    found = _TURNED.fullmatch(ending)
    if found:
        return found["rate"], "", found["axes"]
    found = _ENDING.fullmatch(ending)
    return (None, "", "") if found is None else (found["rate"], found["part"], found["axes"])
