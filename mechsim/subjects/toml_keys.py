"""The keys of a mechanism in TOML, for the reader and for `mechsim schema`."""

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
    """Text; with `options`, one of these words."""

    about: str
    options: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class JointNumber:
    """A number as `Number` with the unit of the joint's coordinate."""

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
    """Return the key of a vector of three numbers."""
    return ListOf(Number(unit, "a component"), about, 3)


def by_coordinate(value_type: KeyType, about: str) -> TableOf:
    """Return the key of a table by coordinate: `joint`, or `joint.way` and `joint.turn`."""
    return TableOf(
        AnyOf((value_type, TableOf(value_type, "of a joint with several coordinates")), value_type.about),
        about,
    )


POINT = AnyOf(
    (
        Text("name of a point"),
        Table(
            {"link": Text("name of a link, or ground"), "at": vector("m", "in the link's frame")},
            "a point on a link",
            ("link",),
        ),
    ),
    "name of a point, or a link and a point in its frame",
)
_VISCOUS, _COULOMB = "viscous friction [N s/m or N m s/rad]", "Coulomb friction [N or N m]"
_FRICTION = Table(
    {
        "viscous": JointNumber(_VISCOUS),
        "coulomb": JointNumber(_COULOMB),
        "viscous_turn": Number("N m s/rad", "viscous friction of the rotation in a cylindrical joint"),
        "coulomb_turn": Number("N m", "Coulomb friction of the rotation in a cylindrical joint"),
        "coefficient": Number("1", "coefficient of friction on the load that the joint transmits"),
        "pin_radius": Number("m", "radius of the pin, ball or thread, at which friction acts"),
        "collar_radius": Number("m", "radius at which the friction of an axial force acts"),
        "bearing_length": Number("m", "distance of the two forces that carry a bending moment"),
        "static": JointNumber("coefficient at rest; without a coefficient, Coulomb friction at rest"),
        "stribeck": JointNumber("rate [rad/s or m/s] by which friction falls to that in motion"),
        "bristle_stiffness": JointNumber("of bristles (LuGre) [N m/rad or N/m]; default rigid"),
        "bristle_damping": JointNumber("of bristles [N m s/rad or N s/m]; default 0"),
    },
    "friction in a joint",
)
_ENDS: dict[str, KeyType] = {"a": POINT, "b": POINT}
_SPRING = Table(
    _ENDS
    | {
        "joint": Text("coordinate along which it acts, instead of a and b"),
        "stiffness": JointNumber("force per elongation [N/m or N m/rad]"),
        "rest": JointNumber("length without force, a number in the unit of the file; default 0"),
        "damping": JointNumber("force per rate of elongation [N s/m or N m s/rad]; default 0"),
        "preload": JointNumber("constant tension [N or N m]; default 0"),
        "force": Text("further tension: an expression of l and v, or FILE.csv with l or v, and force in SI"),
    },
    "a spring, and damper, on the line between two points or in a joint",
)
_DAMPER = Table(
    _ENDS | {"damping": Number("N s/m", "force per rate of elongation")},
    "a damper on the line between two points",
    ("a", "b", "damping"),
)
_JOINT_SPRING = Table(
    {
        "stiffness": JointNumber("stiffness [N/m or N m/rad]"),
        "rest": JointNumber("coordinate without force, a number in the unit of the file; default 0"),
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
        "kind": Text("dependence of the torque on the speed", ("constant", "line", "dc")),
        "torque": Number("N m", "torque of a constant motor"),
        "stall": Number("N m", "torque at rest of a torque-speed line"),
        "no_load": Number("rad/s", "speed of zero torque of a torque-speed line"),
        "voltage": Number("V", "voltage of a dc motor"),
        "resistance": Number("ohm", "armature resistance of a dc motor"),
        "constant": Number("N m/A", "motor constant of a dc motor"),
        "gear": Number("1", "revolutions of the motor per revolution of the crank; default 1"),
    },
    "a motor on the crank",
    ("kind",),
)
# kind of motor -> its required keys
MOTOR_PARAMETERS = {
    "constant": ("torque",),
    "line": ("stall", "no_load"),
    "dc": ("voltage", "resistance", "constant"),
}

_THREE = ListOf(Number("1", "in SI"), "in SI: constant, by length and by rate of length", 3)
_LIMITS = ListOf(Number("1", "in SI"), "lower and upper limit, in SI", 2)
# kind of motor on a joint -> its required keys, and those that it may have
JOINT_MOTORS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "constant": (("torque",), ()),
    "line": (("stall", "no_load"), ()),
    "dc": (("voltage", "resistance", "constant"), ("inductance", "gear")),
    "pd": (("target", "proportional"), ("derivative",)),
    "pid": (("target", "proportional", "integral"), ("derivative",)),
    "expression": (("torque",), ()),
    "general": (
        (),
        (
            "joint",
            "gear",
            "control",
            "gain",
            "bias",
            "direct",
            "inflow",
            "start",
            "control_range",
            "state_range",
        ),
    ),
}
JOINT_MOTOR = Table(
    {
        "kind": Text("what determines the torque or force", tuple(JOINT_MOTORS)),
        "joint": Text("coordinate on which it acts"),
        "torque": JointNumber("constant torque or force, or an expression of J.q, J.v and t in SI"),
        "stall": JointNumber("torque or force at rest"),
        "no_load": JointNumber("rate of zero torque"),
        "voltage": AnyOf((Text("of t"), Number("V", "constant")), "a voltage, or an expression of t in V"),
        "resistance": Number("ohm", "of the armature"),
        "inductance": Number("H", "of the armature; default 0"),
        "constant": Number("N m/A", "motor constant"),
        "gear": AnyOf(
            (Number("1", "a ratio"), TableOf(Number("1", "a ratio"), "by coordinate")),
            "revolutions of the motor per revolution of the joint; of `general` a table by coordinate",
        ),
        "rotor": Number("kg m^2", "moment of inertia before the gear; default 0"),
        "target": JointNumber("coordinate to reach: a number, or an expression of t"),
        "proportional": Number("1", "torque per error, in SI"),
        "integral": Number("1", "torque per error and time, in SI"),
        "derivative": Number("1", "torque per rate of the error, in SI; default 0"),
        "limit": JointNumber("largest torque or force; default: none"),
        "control": AnyOf((Text("of t"), Number("1", "constant")), "of `general`, in SI"),
        "gain": _THREE,
        "bias": _THREE,
        "direct": ListOf(Number("1", "in SI"), "factors of the control and its rate, in SI", 2),
        "inflow": ListOf(Number("1", "in SI"), "of control, state, length and rate of length, in SI", 4),
        "start": Number("1", "initial state, in SI"),
        "control_range": _LIMITS,
        "state_range": _LIMITS,
        "force_range": _LIMITS,
    },
    "a motor or actuator on joints",
    ("kind",),
)
FORCES = Table(
    {
        "motors": TableOf(JOINT_MOTOR, "by name of your choice, fed by --ctrl"),
        "armature": by_coordinate(Number("1", "in kg m2 or kg"), "inertia that moves with a coordinate"),
        "gravity": vector("m/s^2", "in the ground's axes; default 0, -9.81, 0"),
        "friction": TableOf(_FRICTION, "by joint"),
        "springs": TableOf(_SPRING, "by name of your choice"),
        "dampers": TableOf(_DAMPER, "by name of your choice"),
        "joint_springs": TableOf(_JOINT_SPRING, "by joint"),
        "loads": TableOf(_LOAD, "by name of your choice"),
        "couples": TableOf(_COUPLE, "by link"),
        "crank_torque": Profile("N m", "a load on the crank, positive for increasing crank angle"),
        "flywheel": Number("kg m^2", "moment of inertia that rotates with the crank"),
        "motor": MOTOR,
        "controllers": by_coordinate(
            Text("a torque or force in N m or N, of J.q, J.v and t in SI, such as -20*crank.q - 2*crank.v"),
            "torques and forces that depend on the state",
        ),
    },
    "forces on the mechanism, for `dynamics` and scenes of level dynamics",
)


_MOMENT = ListOf(Number("kg m^2", "a moment of inertia"), "a row of the matrix", 3)
_END = Table(
    {
        "link": Text("name of a link, or ground"),
        "at": vector("m", "position of the joint in the link's frame; default: the origin"),
        "axis": vector("1", "direction of the joint's axis in the link's frame; default z"),
        "curve": Text("of side a of a joint of kind curve: a curve of the file"),
        "cam": Text("of side a of a joint of kind cam: a cam of the file"),
        "reference": vector(
            "1",
            "direction of zero joint angle, perpendicular to the axis; default x. If both sides of a slide "
            "have none, the smallest rotation that aligns the axes gives the orientation, or the guess does",
        ),
        "mark": vector("1", "older name of `reference`"),
    },
    "one side of the joint",
    ("link",),
)
_LINK = Table(
    {
        "outline": ListOf(vector("m", "a point"), "points in the link's frame that pictures connect"),
        "polygon": Boolean("whether the outline is a closed polygon, drawn in its order"),
        "inertia": Table(
            {
                "mass": Number("kg", "mass"),
                "centre": vector("m", "centre of mass in the link's frame"),
                "moments": ListOf(
                    AnyOf(
                        (Number("kg m^2", "a moment of inertia"), _MOMENT), "a moment of inertia, or three"
                    ),
                    "about the centre along the link's axes: three moments, or the matrix in three rows",
                    3,
                ),
            },
            "mass, centre and moments; default: a steel rod",
            ("mass", "centre", "moments"),
        ),
    },
    "a moving link",
)
_SIDES = ("left", "right", "outside", "inside")
_RESTITUTION = Number("1", "coefficient of restitution of the contact, 0 to 1; default that of the run")
_JOINT = Table(
    {
        "kind": Text("kind of the joint, its free motions", (*KINDS, "curve", "cam")),
        "a": _END,
        "b": _END,
        "cross_angle": Number(
            "rad", "between the axes of a joint that rotates about both; default: a right angle"
        ),
        "roller": Number(
            "m", "of a joint of kind curve: radius of the roller that b carries; default: a point"
        ),
        "side": Text("of the roller, by default left of increasing s, or outside", _SIDES),
        "lead": Number("m", "displacement of a screw per revolution"),
        "length": Number("m", "of a distance joint, between the points of both sides"),
        "limits": TableOf(
            AnyOf((JointNumber("a limit"), TableOf(JointNumber("a limit"), "of a coordinate")), "a limit"),
            "lower and upper limit of the coordinate, and restitution, 0 to 1, or stiffness and damping; or "
            "these by coordinate",
        ),
        "friction": _FRICTION,
        "backlash": JointNumber("play between the joint and its motor; default 0"),
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
        "ratio": Number("1", "of a gear: revolutions of the driven joint per revolution of the driver"),
        "radius": Number("m", "of a rack: displacement per radian of its pinion"),
        "travel": Number("m", "of a rack, instead of radius: displacement per revolution of its pinion"),
        "coefficients": ListOf(
            JointNumber("coefficient of a power of the driver's coordinate"),
            "of a polynomial: driven as a function of driver, constant first, five at most",
        ),
        "function": Text("driven as an expression of q, the driver, in SI, or FILE.csv with q and value"),
        "periodic": Boolean("whether the table repeats after its last row"),
        "radii": ListOf(Number("m", "a radius"), "of a belt or chain: radii of driver and driven", 2),
        "crossed": Boolean("whether the belt is crossed"),
        "tensioner": Table(
            {"at": vector("m", "its centre on the link of the shafts"), "radius": Number("m", "its radius")},
            "pulley that presses on the outside of a belt",
            ("at", "radius"),
        ),
        "rope": TableOf(
            JointNumber("change of its path: a length per radian of an angle, a number for a slide"),
            "of a rope: changes of its path by coordinate",
        ),
        "length": Number("m", "of a rope or belt"),
        "path": Number("m", "of a rope: length of its path where its coordinates are 0"),
        "phase": JointNumber("driven coordinate at zero of the driver's; default 0"),
        "zeros": ListOf(
            JointNumber("a coordinate"), "zero positions of driven and driver of a polynomial", 2
        ),
        "backlash": JointNumber("of a gear, rack or belt: play of the driven coordinate; default 0"),
        "restitution": _RESTITUTION,
        "turns": Boolean("whether both sides of a polynomial may differ by whole revolutions"),
        "pressure_angle": Number(
            "rad", "pressure angle of a gear or rack, 0 to 90 deg; default 0: the tooth force is tangential"
        ),
    },
    "driven = ratio * driver + phase, a rack, belt, polynomial, function or rope, selected by its keys",
)
_GUESS = Table(
    {
        "at": vector("m", "position of the link's origin"),
        "turn": Table(
            {"axis": vector("1", "axis of rotation"), "angle": Number("rad", "angle of rotation")},
            "rotation from the frame's axes to the link's",
            ("axis", "angle"),
        ),
        "rotation": ListOf(
            ListOf(Number("1", "a cosine"), "a row", 3), "rotation as a matrix, instead of `turn`", 3
        ),
    },
    "approximate pose of a link",
)

# kind of a parameter with formulas -> its unit
PARAMETER_UNITS: dict[str, Unit] = {"length": "m", "position": "m", "angle": "rad", "number": "1"}
_VALUE = AnyOf((Boolean("a choice"), JointNumber("a number")), "a number, or true or false")
PARAMETERS = TableOf(
    Table(
        {
            "value": AnyOf(
                (ListOf(JointNumber("a component"), "a point"), *_VALUE.alternatives), "its default"
            ),
            "kind": Text("length (above 0), position, angle or number", tuple(PARAMETER_UNITS)),
            "choices": ListOf(_VALUE, "the values that it can have"),
            "about": Text("its meaning"),
        },
        "a parameter of formulas",
        ("value", "about"),
    ),
    "parameters of the formulas",
)

_CAM = Table(
    {
        "follower": Table(
            {
                "kind": Text("what touches the cam", ("knife", "roller", "flat")),
                "motion": Text("its motion; default translating", ("translating", "swinging")),
                "radius": Number("m", "of a roller"),
                "offset": Number(
                    "m", "of the slide from the cam's centre, or of a swinging face from its pivot"
                ),
                "arm": Number("m", "from the pivot of a swinging follower to its roller or edge"),
                "centre_distance": Number("m", "from the cam's centre to the pivot of a swinging follower"),
            },
            "the follower",
            ("kind",),
        ),
        "closure": Text("what keeps the contact; default force, as of a spring", ("force", "form")),
        "restitution": _RESTITUTION,
        "base_radius": Number("m", "least radius of the profile at zero lift"),
        "law": AnyOf(
            (
                ListOf(
                    Table(
                        {
                            "over": Number("rad", "its angle of the cam"),
                            "to": JointNumber("lift at its end"),
                            "kind": Text(
                                "law of a rise or return", ("cycloidal", "modified_sine", "polynomial_345")
                            ),
                        },
                        "a rise, return or dwell",
                        ("over",),
                    ),
                    "segments",
                ),
                Text("an expression of q, the angle of the cam, in SI, or FILE.csv with q and value"),
            ),
            "lift as a function of the cam's angle",
        ),
    },
    "a cam",
    ("follower", "base_radius", "law"),
)
# inertia of a link that only connects joints
MASSLESS = {"inertia": {"mass": 0.0, "centre": [0.0] * 3, "moments": [0.0] * 3}}

ROOT = Table(
    {
        "name": Text("name of the mechanism"),
        "units": Table(
            {"length": Text("such as mm; default m"), "angle": Text("such as deg; default rad")},
            "units of numbers without a unit",
        ),
        "drivers": ListOf(
            Text("name of a revolute or prismatic joint, or NAME.way or NAME.turn of a cylindrical one"),
            "driven coordinates; one revolute joint is the crank; default crank, or all of an open chain",
        ),
        "parameters": TableOf(
            AnyOf(
                (
                    Number("1", "a number, a quantity, or an expression of parameters before it"),
                    PARAMETERS.value_type,
                ),
                "a number, a quantity, an expression of parameters before it, or a table",
            ),
            "numbers that the file uses by name and --set changes",
        ),
        "links": TableOf(_LINK, "moving links; a link that several joints name needs no table"),
        "joints": TableOf(_JOINT, "joints"),
        "couplings": TableOf(_COUPLING, "gears, racks and polynomials between coordinates"),
        "curves": TableOf(
            Table(
                {axis: Text(f"{axis} in m as an expression of s") for axis in "xyz"}
                | {
                    "table": Text("FILE.csv with x, y, maybe z and s, instead of expressions"),
                    "closed": Boolean("whether it repeats after 2 pi, its range or its table"),
                    "range": ListOf(Number("1", "a value of s"), "first and last s of expressions", 2),
                },
                "a curve of a link",
            ),
            "curves for joints of kind curve",
        ),
        "cams": TableOf(_CAM, "cams for joints of kind cam"),
        "points": TableOf(
            Table(
                {"link": Text("name of a link"), "at": vector("m", "in the link's frame")},
                "a point",
                ("link",),
            ),
            "tracked points",
        ),
        "start": AnyOf(
            (
                JointNumber("value of a single driver"),
                by_coordinate(JointNumber("its value at the guess"), "by coordinate"),
            ),
            "position of the driver at the guess, or a table by coordinate; default 0",
        ),
        "locked": by_coordinate(JointNumber("its constant value"), "locked coordinates"),
        "motion_laws": by_coordinate(
            Text("such as 600rpm, 30deg*sin(2*pi*t) with t in s, or FILE.csv"), "motion laws of the drivers"
        ),
        "programs": by_coordinate(Text("a motion law"), "older name of `motion_laws`"),
        "duration": Number("s", "duration of the motion laws"),
        "initial": TableOf(
            AnyOf(
                (
                    TableOf(
                        AnyOf(
                            (
                                JointNumber("value of q, the coordinate, or v, its rate"),
                                ListOf(JointNumber("a component"), "q = [x, y, z, angle] or w of a ball"),
                                TableOf(JointNumber("value of q or v"), "of a coordinate"),
                            ),
                            "of a coordinate",
                        ),
                        "of a joint",
                    ),
                ),
                "of a joint",
            ),
            "initial state of `dynamics`, such as crank.q and crank.v",
        ),
        "forces": FORCES,
        "display": Table(
            {"up": Text("axis that points up; default: against gravity, else y", AXES)}, "of pictures"
        ),
        "guess": TableOf(_GUESS, "approximate poses of links, which select the assembly mode"),
        "formula": Table(
            {"python": Text("FILE.py:FUNCTION, the user's own model of the motion")}, "an analytic model"
        ),
    },
    "a mechanism",
    ("name", "joints"),
)


def schema() -> dict[str, Any]:
    """Return the JSON Schema of a mechanism's file, for editors."""
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
