"""Names of quantities, such as P.x, rocker.v, torque:J or distance:P,Q: one grammar for all studies.

A quantity is a function of columns of motions and forces. A name has the same meaning in the formulas and
tables of `validate`, in the measures of `sweep`, in `sensitivity` and `fit`. A new kind of
quantity is a row of `KINDS`; a field of `ForceRecord` with a unit is a quantity by its name.
"""

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields
from difflib import get_close_matches
from typing import Any, Literal

import numpy as np

from mechsim.errors import InputError, first_names
from mechsim.mechanism.expressions import Evaluator, Term, parse_expression, unit_powers, unit_text
from mechsim.mechanism.force_record import COMPONENTS, ForceRecord
from mechsim.mechanism.joint_kinds import KINDS as JOINT_KINDS
from mechsim.mechanism.links import AXES, GROUND
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motion_plane import PARALLEL_TOLERANCE, plane_normals
from mechsim.mechanism.quantity import ELEMENTS, TRANSMISSION, Column, Function, Quantity, Source, link_column
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import angle_of

# columns that only the analytic inverse dynamics has, and their SI units
FORMULA_COLUMNS = {"inertia": "kg m2", "inertia_derivative": "kg m2/rad", "power_stored": "W"}
# subject of the total reaction of the ground on all links
FRAME = "frame"


@dataclass(frozen=True, slots=True)
class QuantityKind:
    """A kind of quantity and the form of its names.

    Attributes:
        name: name of the kind.
        unit: in SI; of coordinates, the ending of the unit after that of the coordinate.
        subject: "point", "coordinate", "joint", or "" if `derive` reads the text after the colon.
        letter: letter after the subject's name and a dot; components follow it, as in P.vx.
        order: number of time derivatives.
        word: word before the colon, as in force:J; empty if there is none.
        derive: (mechanism, text after the colon) -> columns, function and unit; None if columns are its
            components.
        pair: whether two names follow the colon.
    """

    name: str
    unit: str = ""
    subject: Literal["point", "coordinate", "joint", ""] = ""
    letter: str = ""
    order: int = 0
    word: str = ""
    derive: "Callable[[Mechanism, str], tuple[Sequence[Column], Function, str]] | None" = None
    pair: bool = False


def quantity(name: str, mechanism: Mechanism, *, scalar: bool | None = None) -> Quantity:
    """Return the quantity with a name.

    Args:
        name: of a point P, P.x, P.v, P.vx, P.a; of a joint J, J.v, J.a, J.q1 for joints with several
            coordinates; torque, torque:J, force:J, moment:J, J.fx, J.mz; kinetic and other columns of forces;
            speed:P, acceleration:P, distance:P,Q, angle:LINK,LINK, transmission; or expr:EXPRESSION of
            quantities.
        mechanism: the mechanism.
        scalar: if a joint and a point share a name, True selects the joint and False the point. None selects
            the point for the name alone, else the joint.

    Raises:
        InputError: for any other name; the message suggests the nearest one.
    """
    word, colon, rest = name.partition(":")
    row = next((row for row in KINDS.values() if colon and row.word == word), None)
    result = None
    if row is not None and row.derive is not None:
        columns, function, unit = row.derive(mechanism, rest)
        return Quantity(name, row.name, rest, unit, tuple(columns), "", function)
    if row is not None:
        result = _direct(name, rest, mechanism, [row])
    elif colon and word == "torque":
        result = _drive_effort(name, rest, mechanism)
    elif not colon:
        rows = [row for row in KINDS.values() if row.derive is None]
        prefer_joint = "." in name if scalar is None else scalar
        rows.sort(key=lambda row: (row.subject == "coordinate") != prefer_joint)
        result = _effort(name, mechanism) or _direct(name, name, mechanism, rows)
    if result is None:
        raise unknown(name, mechanism)
    return result


def numeric_quantity(name: str, mechanism: Mechanism) -> Quantity:
    """Return a quantity as a scalar at each instant: of vectors the length, except of positions.

    Raises:
        InputError: for an unknown name, or a position.
    """
    result = quantity(name, mechanism, scalar=True)
    if len(result.columns) > 1 and result.function is None and result.kind in ("position", "joint"):
        raise unknown(name, mechanism)
    return result


def scalar_quantities(names: Iterable[str], mechanism: Mechanism) -> list[Quantity]:
    """Return the quantities with these names as distinct scalars: of vectors all components.

    Raises:
        InputError: for an unknown name, or no name at all.
    """
    result = {
        component.name: component for name in names for component in quantity(name, mechanism).scalars()
    }
    if not result:
        raise InputError("no quantity is requested; name some, such as P3,rocker,torque")
    return list(result.values())


def unknown(name: str, mechanism: Mechanism) -> InputError:
    """Return the error for an unknown name, with the nearest known name."""
    joints = [joint.name for joint in mechanism.joints]
    points = moving_points(mechanism)
    short = list(dict.fromkeys([*points, *joints, *coordinate_units(mechanism)]))
    columns = [f"{point}.x" for point in points]
    word, colon, rest = name.partition(":")
    point = (rest if colon else name).partition(".")[0]
    if point in mechanism.points and point not in points:
        return InputError(
            f"{point} of {mechanism.name} is a fixed point of the frame, so that {name} is constant; "
            f"distance:P,{point} is a quantity"
        )
    words = [f"{word}:{subject}" for subject in short] if colon else []
    choices = [*short, *columns, "torque", TRANSMISSION, *words]
    close = get_close_matches(name, [other for other in choices if other != name], n=1)
    hint = f"; did you mean {close[0]!r}?" if close else ";"
    names = (
        f"choose from points and joints ({first_names(short)}) and names such as P.x, J.v, torque:J, "
        "distance:P,Q"
    )
    return InputError(f"{mechanism.name} has no quantity {name!r}{hint} {names}")


def moving_points(mechanism: Mechanism) -> list[str]:
    """Return the points on moving links; motions have no columns of points of the frame."""
    return [point for point, (link, _) in mechanism.points.items() if link != GROUND]


def coordinate_units(mechanism: Mechanism) -> dict[str, str]:
    """Return the unit of each joint coordinate."""
    return {
        coordinate: unit
        for joint in mechanism.joints
        for coordinate, unit in zip(joint.coordinates, JOINT_KINDS[joint.kind].units, strict=True)
    }


# letter, number of the coordinate, axes: P.vx, J.q1; or axes before the letter: P.xv
_ENDING = re.compile(r"(?P<letter>[qvafm]?)(?P<number>\d?)(?P<axes>[xyz]{0,3})")
_REVERSED_ENDING = re.compile(r"(?P<axes>[xyz]{1,3})(?P<letter>[va])(?P<number>)")


def _direct(name: str, text: str, mechanism: Mechanism, rows: Sequence[QuantityKind]) -> Quantity | None:
    """Return the quantity whose columns are its components: of a point, coordinate or joint."""
    words, joints = text.split("."), [joint.name for joint in mechanism.joints]
    subjects = {"point": moving_points(mechanism), "joint": [FRAME, *joints]}
    for i in range(len(words), 0, -1):
        subject, ending = ".".join(words[:i]), "".join(words[i:])
        match = _REVERSED_ENDING.fullmatch(ending) or _ENDING.fullmatch(ending)
        for row in rows if match else ():
            assert match is not None
            letter = match["letter"] or (row.letter if row.word and name.startswith(f"{row.word}:") else "")
            if row.subject == "coordinate":
                if letter in (row.letter, "" if row.letter == "q" else row.letter) and not match["axes"]:
                    columns = _coordinates(subject, match["number"], row, mechanism)
                    if columns:
                        return Quantity(name, row.name, columns[0].subject, columns[0].unit, columns)
            elif letter == row.letter and not match["number"] and subject in subjects[row.subject]:
                axes = match["axes"] or AXES
                if len(set(axes)) == len(axes):
                    source: Source = "point" if row.subject == "point" else "force"
                    source = "formula" if subject == FRAME and source == "force" else source
                    columns = tuple(
                        Column(f"{subject}.{row.letter}{axis}", row.unit, source, subject, row.order)
                        for axis in axes
                    )
                    return Quantity(name, row.name, subject, row.unit, columns, axes)
    return None


def _coordinates(subject: str, number: str, row: QuantityKind, mechanism: Mechanism) -> tuple[Column, ...]:
    """Return the columns of a coordinate, or of one or all coordinates of a joint."""
    units = coordinate_units(mechanism)
    for joint in mechanism.joints:
        if subject == joint.name or subject in joint.coordinates:
            return tuple(
                Column(
                    f"{joint.name}.{row.letter}{i if len(joint.coordinates) > 1 else ''}",
                    units[coordinate] + row.unit,
                    "joint",
                    coordinate,
                    row.order,
                )
                for i, coordinate in enumerate(joint.coordinates)
                if coordinate in units
                and (subject == coordinate or (subject == joint.name and number in ("", str(i))))
            )
    return ()


def _drive_effort(name: str, coordinate: str, mechanism: Mechanism) -> Quantity | None:
    """Return the torque or force of a drive or of a locked coordinate."""
    if coordinate not in (*mechanism.drivers, *mechanism.locked):
        return None
    crank = mechanism.has_crank and coordinate == mechanism.crank.name
    column = "torque" if crank else f"drive {coordinate}"
    unit = "N" if coordinate in mechanism.straight else "N m"
    return Quantity(name, "torque", coordinate, unit, (Column(column, unit, "force", coordinate),))


def _effort(name: str, mechanism: Mechanism) -> Quantity | None:
    """Return the quantity that is a column of forces, energies or powers."""
    if name == TRANSMISSION:
        return Quantity(name, name, "", "rad", (Column(name, "rad", "formula", ""),))
    if name == "torque" and mechanism.has_crank:
        return _drive_effort(name, mechanism.crank.name, mechanism)
    word, _, rest = name.partition(" ")
    units = effort_units()
    coupling, _, component = rest.rpartition(".")
    if word == "drive":
        return _drive_effort(name, rest, mechanism)
    if word == "gear" and rest in mechanism.named_laws:
        unit = "N" if rest in mechanism.straight else "N m"
    elif word == "mesh" and coupling in mechanism.named_laws and component in COMPONENTS[:3]:
        unit = "N"
    elif name in units:
        unit = units[name]
    else:
        return None
    source: Source = "formula" if name in FORMULA_COLUMNS else "force"
    return Quantity(name, "effort", name, unit, (Column(name, unit, source, name),))


def effort_units() -> dict[str, str]:
    """Return column -> SI unit of energies, powers and other fields of `ForceRecord` with a unit."""
    return {f.name: f.metadata["unit"] for f in fields(ForceRecord) if "unit" in f.metadata} | FORMULA_COLUMNS


def _length(values: Sequence[Array]) -> Array:
    return np.sqrt(sum(value**2 for value in values))


def _rate_of_point(letter: str, order: int) -> "Callable[[Mechanism, str], Any]":
    """Return the derivation of the magnitude of a point's velocity or acceleration."""

    def derive(mechanism: Mechanism, point: str) -> tuple[Sequence[Column], Function, str]:
        if point not in moving_points(mechanism):
            raise unknown(point, mechanism)
        return (quantity(f"{point}.{letter}", mechanism).columns, _length, f"m/s{'2'[: order - 1]}")

    return derive


def _distance(mechanism: Mechanism, text: str) -> tuple[Sequence[Column], Function, str]:
    """Return the derivation of the distance of two points."""
    columns: list[Column] = []
    frame: list[Sequence[float]] = []
    for point in _pair("distance:P,Q", text):
        if point not in mechanism.points:
            raise InputError(
                f"{mechanism.name} has no point {point!r}; choose from {first_names(mechanism.points)}"
            )
        link, position = mechanism.points[point]
        if link == GROUND:
            frame.append(position)
        else:
            columns += quantity(f"{point}.xyz", mechanism).columns
    if not columns:
        raise InputError(f"distance:{text} is constant: both are points of the frame; name one that moves")

    def distance(values: Sequence[Array]) -> Array:
        others: Sequence[Any] = values[3:] if len(values) > 3 else frame[0]
        return _length([a - b for a, b in zip(values[:3], others, strict=True)])

    return columns, distance, "m"


def _angle(mechanism: Mechanism, text: str) -> tuple[Sequence[Column], Function, str]:
    """Return the derivation of the angle by which a link is rotated relative to another.

    In a planar mechanism the angle is signed, about the direction of the crank's axis; in a spatial mechanism
    it lies between 0 and pi.
    """
    names = _pair("angle:LINK,LINK", text)
    for link in names:
        if link not in mechanism.link_names:
            listed = first_names(mechanism.link_names)
            raise InputError(f"{mechanism.name} has no link {link!r}; choose from {listed}")
    moving = [link for link in names if link != GROUND]
    columns = [
        Column(link_column(link, *element), "1", "link", link) for link in moving for element in ELEMENTS
    ]
    normals = plane_normals(mechanism) or {}
    normal, other = (normals.get(link) for link in names)
    signed = normal is not None and other is not None and np.abs(normal - other).max() < PARALLEL_TOLERANCE

    def angle(values: Sequence[Array]) -> Array:
        rotations = iter(np.reshape(values, (-1, 3, 3, *values[0].shape)))
        still = np.eye(3)[(..., *[None] * values[0].ndim)]
        first, second = (still if link == GROUND else next(rotations) for link in names)
        relative = np.einsum("ki...,kj...->ij...", first, second)
        cosine = 0.5 * (np.trace(relative) - 1.0)
        axis = [0.5 * (relative[i - 1, i - 2] - relative[i - 2, i - 1]) for i in range(3)]
        if signed and normal is not None:
            return angle_of(np.tensordot(normal, axis, 1), cosine)
        return angle_of(_length(axis), cosine)

    return columns, angle, "rad"


def _pair(usage: str, text: str) -> list[str]:
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2 or names[0] == names[1] or not all(names):
        raise InputError(
            f"{usage.partition(':')[0]}:{text} does not name two different ones; write it as {usage}"
        )
    return names


def _expression(mechanism: Mechanism, text: str) -> tuple[Sequence[Column], Function, str]:
    """Return the derivation of an expression of quantities, such as distance:P,Q/0.1 - P.x."""
    quantities: dict[str, Quantity] = {}

    def placeholder(match: re.Match[str]) -> str:
        if match[0] == "pi":
            return match[0]
        quantities.setdefault(match[0], numeric_quantity(match[0], mechanism))
        return f"quantity_{list(quantities).index(match[0])}_"

    pairs = "|".join(row.word for row in KINDS.values() if row.pair)
    name = rf"(?:(?:{pairs}):[^\W\d][\w.]*,[^\W\d][\w.]*|(?:[^\W\d]\w*:)?[^\W\d][\w.]*)"
    try:
        tree = parse_expression(re.sub(rf"(?<![\w.]){name}(?![\w.]*\s*\()", placeholder, text))
        columns = list(
            dict.fromkeys(column for quantity in quantities.values() for column in quantity.columns)
        )

        def evaluate(values: Sequence[Array]) -> Term:
            by_name = dict(zip([column.name for column in columns], values, strict=True))
            terms = [
                Term(quantity.number(by_name), unit_powers(quantity.unit)) for quantity in quantities.values()
            ]
            names = {f"quantity_{i}_": term for i, term in enumerate(terms)}
            with np.errstate(all="ignore"):
                return Evaluator(names.__getitem__).evaluate(tree)

        if not columns:
            raise InputError("contains no quantity such as P.x")
        probe = evaluate([np.full(1, 0.5) for _ in columns])
        if probe.without_unit == "variable":
            raise InputError("adds a plain number that varies and a quantity; give both one unit")
        unit = unit_text(probe.powers)
    except InputError as error:
        raise InputError(f"the expression {text!r}: {error}") from None
    return columns, lambda values: np.asarray(evaluate(values).value), unit


# validate, sweep, sensitivity and fit read these rows
KINDS = {
    row.name: row
    for row in (
        QuantityKind("position", "m", "point"),
        QuantityKind("velocity", "m/s", "point", "v", 1),
        QuantityKind("acceleration", "m/s2", "point", "a", 2),
        QuantityKind("joint", "", "coordinate", "q"),
        QuantityKind("joint rate", "/s", "coordinate", "v", 1),
        QuantityKind("joint acceleration", "/s2", "coordinate", "a", 2),
        QuantityKind("force", "N", "joint", "f", word="force"),
        QuantityKind("moment", "N m", "joint", "m", word="moment"),
        QuantityKind("speed", word="speed", derive=_rate_of_point("v", 1)),
        QuantityKind("size of acceleration", word="acceleration", derive=_rate_of_point("a", 2)),
        QuantityKind("distance", word="distance", derive=_distance, pair=True),
        QuantityKind("angle", word="angle", derive=_angle, pair=True),
        QuantityKind("expression", word="expr", derive=_expression),
    )
}


def quantity_names(text: str) -> tuple[str, ...]:
    """Return the names in a comma-separated list; commas inside names and brackets do not separate.

    Example:
        >>> quantity_names("rocker,distance:A,B,expr:atan2(B.y, B.x)")
        ('rocker', 'distance:A,B', 'expr:atan2(B.y, B.x)')
    """
    pairs = "|".join(row.word for row in KINDS.values() if row.pair)
    names: list[str] = []
    for piece in text.split(","):
        open_name = names and (
            names[-1].count("(") > names[-1].count(")")
            or re.search(rf"(?<![\w.])(?:{pairs}):[^\W\d][\w.]*$", names[-1])
        )
        if open_name:
            names[-1] += f",{piece}"
        else:
            names.append(piece)
    return tuple(names)
