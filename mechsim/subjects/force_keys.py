"""The keys of `[forces]` in TOML: what acts on a mechanism."""

from mechsim.subjects.key_types import (
    AnyOf,
    JointNumber,
    KeyType,
    ListOf,
    Number,
    Profile,
    Table,
    TableOf,
    Text,
    vector,
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
    },
    "what acts on the mechanism, for `dynamics` and scenes of level dynamics",
)
