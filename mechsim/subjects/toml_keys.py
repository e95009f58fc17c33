"""The keys of a mechanism in TOML: what the reader checks by and `mechsim schema` is made from."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mechsim.model.joint_kinds import KINDS
from mechsim.model.mechanism import AXES
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


POINT = AnyOf(
    (
        Text("name of a point"),
        Table(
            {"link": Text("name of a link, or ground"), "at": vector("m", "in the link's frame")},
            "a place on a link",
            ("link",),
        ),
    ),
    "name of a point, or link and place in its frame",
)
_VISCOUS, _DRY = "viscous friction, per unit of the joint's rate", "dry friction, a force or a moment"
_FRICTION = Table(
    {
        "viscous": JointNumber(_VISCOUS),
        "coulomb": JointNumber(_DRY),
        "viscous_turn": Number("N m s/rad", "the same of the turning in a cylindrical joint"),
        "coulomb_turn": Number("N m", "the same of the turning in a cylindrical joint"),
    },
    "friction in a joint",
)
_ENDS: dict[str, KeyType] = {"a": POINT, "b": POINT}
_SPRING = Table(
    _ENDS
    | {
        "stiffness": Number("N/m", "force per elongation"),
        "rest": Number("m", "length without force; 0 if left out"),
        "damping": Number("N s/m", "force per rate of elongation; 0 if left out"),
    },
    "a spring, and damper, on the line between two places",
    ("a", "b", "stiffness"),
)
_DAMPER = Table(
    _ENDS | {"damping": Number("N s/m", "force per rate of elongation")},
    "a damper on the line between two places",
    ("a", "b", "damping"),
)
_JOINT_SPRING = Table(
    {
        "stiffness": JointNumber("force or moment per unit of the joint's coordinate"),
        "rest": JointNumber("the coordinate without force; 0 if left out"),
    },
    "a spring in a revolute or prismatic joint",
    ("stiffness",),
)
_LOAD = Table(
    {"at": POINT, "force": ListOf(Profile("N", "a component"), "in the ground's axes", 3)},
    "a force on a point",
    ("at", "force"),
)
_COUPLE = ListOf(Profile("N m", "a component"), "moment in the ground's axes", 3)
MOTOR = Table(
    {
        "kind": Text("how its torque goes with speed", ("constant", "line", "dc")),
        "torque": Number("N m", "of a constant one"),
        "stall": Number("N m", "of a line: torque at rest"),
        "no_load": Number("rad/s", "of a line: speed at which the torque vanishes"),
        "voltage": Number("V", "of a dc motor"),
        "resistance": Number("ohm", "of a dc motor's armature"),
        "constant": Number("N m/A", "of a dc motor"),
        "gear": Number("1", "turns of the motor per turn of the crank; 1 if left out"),
    },
    "a motor on the crank",
    ("kind",),
)
# kind of motor -> the keys that it needs
MOTOR_PARAMETERS = {
    "constant": ("torque",),
    "line": ("stall", "no_load"),
    "dc": ("voltage", "resistance", "constant"),
}

FORCES = Table(
    {
        "gravity": vector("m/s^2", "in the ground's axes; 0, -9.81, 0 if left out"),
        "friction": TableOf(_FRICTION, "by joint"),
        "springs": TableOf(_SPRING, "under names of your own"),
        "dampers": TableOf(_DAMPER, "under names of your own"),
        "joint_springs": TableOf(_JOINT_SPRING, "by joint"),
        "loads": TableOf(_LOAD, "under names of your own"),
        "couples": TableOf(_COUPLE, "by link"),
        "crank_torque": Profile("N m", "a load on the crank, positive as its angle rises"),
        "flywheel": Number("kg m^2", "moment of inertia that turns with the crank"),
        "motor": MOTOR,
        "controllers": by_coordinate(
            Text("an effort in N m or N, of J.q, J.v and t in SI, as -20*crank.q - 2*crank.v"),
            "efforts that depend on the state",
        ),
    },
    "what acts on the mechanism, for `dynamics` and scenes of level dynamics",
)


_MOMENT = ListOf(Number("kg m^2", "a moment of inertia"), "a row of the matrix", 3)
_END = Table(
    {
        "link": Text("name of a link, or ground"),
        "at": vector("m", "where the joint is, in the link's frame; the origin if left out"),
        "axis": vector("1", "direction of the joint's axis in the link's frame; z if left out"),
        "reference": vector(
            "1",
            "direction across the axis from which the angle is counted; x if left out; where both "
            "sides of a slide leave it out, links turn by the least that lays axis on axis, if not guessed",
        ),
        "mark": vector("1", "older name of `reference`"),
    },
    "one side of the joint",
    ("link",),
)
_LINK = Table(
    {
        "outline": ListOf(vector("m", "a point"), "points in the link's frame that a picture joins up"),
        "inertia": Table(
            {
                "mass": Number("kg", "mass"),
                "centre": vector("m", "centre of mass in the link's frame"),
                "moments": ListOf(
                    AnyOf(
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
_JOINT = Table(
    {
        "kind": Text("what it leaves free", tuple(KINDS)),
        "a": _END,
        "b": _END,
        "cross_angle": Number("rad", "between the axes of a universal joint; a right angle if left out"),
        "lead": Number("m", "of a screw, displacement a turn"),
    },
    "a joint",
    ("kind", "a", "b"),
)
_SIDE = AnyOf(
    (
        Text("name of a coordinate"),
        TableOf(Number("1", "its weight"), "coordinates and their weights, for their sum"),
    ),
    "name of a coordinate, or a table of coordinates and weights",
)
_COUPLING = Table(
    {
        "driver": _SIDE,
        "driven": _SIDE,
        "ratio": Number("1", "of a gear: turns of the driven joint per turn of the driver"),
        "radius": Number("m", "of a rack: displacement per radian of its pinion"),
        "travel": Number("m", "of a rack, instead: displacement per turn of its pinion"),
        "coefficients": ListOf(
            JointNumber("of a power of the driver's coordinate"),
            "of a polynomial: driven as a function of driver, from the constant up, five at most",
        ),
        "phase": JointNumber("driven coordinate where the driver's is zero; 0 if left out"),
        "zeros": ListOf(
            JointNumber("a coordinate"), "of driven and driver, from which a polynomial counts", 2
        ),
        "turns": Boolean("whether whole turns between both sides of a polynomial do not count"),
        "pressure_angle": Number(
            "rad", "of the teeth of a gear or rack, 0 to 90 deg; 0 if left out: the tooth force is tangential"
        ),
    },
    "driven = ratio * driver + phase, a rack, or a polynomial, selected by its keys",
    ("driven",),
)
_GUESS = Table(
    {
        "at": vector("m", "of the link's origin"),
        "turn": Table(
            {"axis": vector("1", "to turn about"), "angle": Number("rad", "by how much")},
            "from the frame's axes to the link's",
            ("axis", "angle"),
        ),
        "rotation": ListOf(
            ListOf(Number("1", "a cosine"), "a row", 3), "the same as a matrix, instead of `turn`", 3
        ),
    },
    "roughly where a link is",
)

ROOT = Table(
    {
        "name": Text("of the mechanism"),
        "units": Table(
            {"length": Text("as in mm; m if left out"), "angle": Text("as in deg; rad if left out")},
            "of numbers without a unit of their own",
        ),
        "drivers": ListOf(
            Text("name of a revolute or prismatic joint, or NAME.way or NAME.turn of a cylindrical one"),
            "what is driven; a lone revolute joint is the crank",
        ),
        "parameters": TableOf(
            Number("1", "a number, a quantity, or an expression of parameters before it"),
            "numbers used below by name, and changed by --set",
        ),
        "links": TableOf(_LINK, "moving links; one that several joints name needs no table"),
        "joints": TableOf(_JOINT, "joints"),
        "couplings": TableOf(_COUPLING, "gears, racks and polynomials between coordinates"),
        "points": TableOf(
            Table(
                {"link": Text("name of a link"), "at": vector("m", "in the link's frame")},
                "a point",
                ("link",),
            ),
            "points whose motion is wanted",
        ),
        "start": AnyOf(
            (
                JointNumber("of the one driver"),
                by_coordinate(JointNumber("its value at the guess"), "by coordinate"),
            ),
            "where the driver stands at the guess, or a table by coordinate; 0 if left out",
        ),
        "locked": by_coordinate(JointNumber("where it is held"), "coordinates that do not move"),
        "motion_laws": by_coordinate(
            Text("as in 600rpm, 30deg*sin(2*pi*t) with t in s, or FILE.csv"), "how drivers move over time"
        ),
        "programs": by_coordinate(Text("a motion law"), "older name of `motion_laws`"),
        "duration": Number("s", "of the motion laws"),
        "initial": TableOf(
            AnyOf(
                (
                    TableOf(JointNumber("of q, the coordinate, and v, its rate"), "of a joint"),
                    TableOf(TableOf(JointNumber("of q and v"), "of a coordinate"), "of a joint with several"),
                ),
                "of a joint",
            ),
            "state from which `dynamics` releases the mechanism, as crank.q and crank.v",
        ),
        "forces": FORCES,
        "display": Table(
            {"up": Text("axis that points up; against gravity, else y, if left out", AXES)}, "of pictures"
        ),
        "guess": TableOf(_GUESS, "which assembly is meant: rough places of links"),
        "formula": Table(
            {"python": Text("FILE.py:FUNCTION, the user's own model of the motion")}, "an analytic model"
        ),
    },
    "a mechanism",
    ("name", "joints"),
)


def schema() -> dict[str, Any]:
    """Return the JSON Schema by which an editor completes and checks a mechanism's file."""
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "A mechanism for mechsim"}
    return head | _schema_of(ROOT)


def _schema_of(key: KeyType) -> dict[str, Any]:
    match key:
        case Number(unit=unit):
            return {"description": f"{key.about} [{unit}]", "type": ["number", "string"]}
        case Profile(unit=unit):
            about = f"{key.about} [{unit}], an expression of t or angle, or FILE.csv"
            return {"description": about, "type": ["number", "string"]}
        case JointNumber():
            return {"description": key.about, "type": ["number", "string"]}
        case Boolean():
            return {"description": key.about, "type": "boolean"}
        case Text(options=options):
            listed: dict[str, Any] = {"enum": list(options)} if options else {}
            return {"description": key.about, "type": "string"} | listed
        case ListOf(item=inner, count=count):
            bounds = {} if count is None else {"minItems": count, "maxItems": count}
            return {"description": key.about, "type": "array", "items": _schema_of(inner)} | bounds
        case TableOf(value_type=inner):
            return {"description": key.about, "type": "object", "additionalProperties": _schema_of(inner)}
        case Table(keys=keys, required=required):
            properties = {name: _schema_of(entry) for name, entry in keys.items()}
            table: dict[str, Any] = {
                "type": "object",
                "properties": properties,
                "additionalProperties": False,
            }
            return {"description": key.about} | table | ({"required": list(required)} if required else {})
        case AnyOf(alternatives=inner):
            return {"description": key.about, "anyOf": [_schema_of(entry) for entry in inner]}
