"""The keys of a mechanism in TOML: what the reader checks by and `mechsim schema` is made from."""

from mechsim.model.joint_kinds import KINDS
from mechsim.model.vertical import AXES
from mechsim.subjects.force_keys import FORCES
from mechsim.subjects.key_types import (
    AnyOf,
    Boolean,
    JointNumber,
    ListOf,
    Number,
    Table,
    TableOf,
    Text,
    by_coordinate,
    vector,
)

_MOMENT = ListOf(Number("kg m^2", "a moment of inertia"), "a row of the matrix", 3)
_END = Table(
    {
        "link": Text("name of a link, or ground"),
        "at": vector("m", "where the joint is, in the link's frame; the origin if left out"),
        "axis": vector("1", "direction of the joint's axis in the link's frame; z if left out"),
        "mark": vector(
            "1",
            "direction across the axis from which the angle is counted; x if left out; where both "
            "sides of a slide leave it out, links turn by the least that lays axis on axis, if not guessed",
        ),
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
    "driven = ratio * driver + phase, a rack, or a polynomial: told by its keys",
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
        "programs": by_coordinate(
            Text("as in 600rpm, 30deg*sin(2*pi*t) with t in s, or FILE.csv"), "how drivers go over time"
        ),
        "duration": Number("s", "of the programs"),
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
