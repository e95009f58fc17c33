"""The keys of `[forces]` in TOML: what acts on a mechanism."""

from mechsim.subjects.key_kinds import Amount, Choice, Course, Key, Keys, Named, Number, Several, Word, vector

PLACE = Choice(
    (
        Word("name of a point"),
        Keys(
            {"link": Word("name of a link, or ground"), "at": vector("m", "in the link's frame")},
            "a place on a link",
            ("link",),
        ),
    ),
    "name of a point, or link and place in its frame",
)
_VISCOUS, _DRY = "viscous friction, per unit of the joint's rate", "dry friction, a force or a moment"
_FRICTION = Keys(
    {
        "viscous": Amount(_VISCOUS),
        "coulomb": Amount(_DRY),
        "viscous_turn": Number("N m s/rad", "the same of the turning in a cylindrical joint"),
        "coulomb_turn": Number("N m", "the same of the turning in a cylindrical joint"),
    },
    "friction in a joint",
)
_ENDS: dict[str, Key] = {"a": PLACE, "b": PLACE}
_SPRING = Keys(
    _ENDS
    | {
        "stiffness": Number("N/m", "force per elongation"),
        "rest": Number("m", "length without force; 0 if left out"),
        "damping": Number("N s/m", "force per rate of elongation; 0 if left out"),
    },
    "a spring, and damper, on the line between two places",
    ("a", "b", "stiffness"),
)
_DAMPER = Keys(
    _ENDS | {"damping": Number("N s/m", "force per rate of elongation")},
    "a damper on the line between two places",
    ("a", "b", "damping"),
)
_JOINT_SPRING = Keys(
    {
        "stiffness": Amount("force or moment per unit of the joint's coordinate"),
        "rest": Amount("the coordinate without force; 0 if left out"),
    },
    "a spring in a revolute or prismatic joint",
    ("stiffness",),
)
_LOAD = Keys(
    {"at": PLACE, "force": Several(Course("N", "a component"), "in the ground's axes", 3)},
    "a force on a point",
    ("at", "force"),
)
_COUPLE = Several(Course("N m", "a component"), "moment in the ground's axes", 3)
MOTOR = Keys(
    {
        "kind": Word("how its torque goes with speed", ("constant", "line", "dc")),
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
MOTORS = {
    "constant": ("torque",),
    "line": ("stall", "no_load"),
    "dc": ("voltage", "resistance", "constant"),
}

FORCES = Keys(
    {
        "gravity": vector("m/s^2", "in the ground's axes; 0, -9.81, 0 if left out"),
        "friction": Named(_FRICTION, "by joint"),
        "springs": Named(_SPRING, "under names of your own"),
        "dampers": Named(_DAMPER, "under names of your own"),
        "joint_springs": Named(_JOINT_SPRING, "by joint"),
        "loads": Named(_LOAD, "under names of your own"),
        "couples": Named(_COUPLE, "by link"),
        "crank_torque": Course("N m", "a load on the crank, positive as its angle rises"),
        "flywheel": Number("kg m^2", "moment of inertia that turns with the crank"),
        "motor": MOTOR,
    },
    "what acts on the mechanism, for `dynamics` and scenes of level dynamics",
)
