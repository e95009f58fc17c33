"""Text of the command line to forces: gravity, friction, motors, load tables."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mechsim.analytic.catalog.base import ClosedForm
    from mechsim.model.forces import Forces, Friction, JointSpring, Place, Spring
    from mechsim.model.motors import Motor, PlainMotor

MOTORS = {
    "constant": "constant:TORQUE in N m",
    "line": "line:STALL in N m,NO-LOAD speed",
    "dc": "dc:VOLTAGE in V,RESISTANCE in ohm,CONSTANT in N m/A",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Given:
    """The options about forces as they were written.

    Attributes:
        gravity: three numbers.
        load: a file.
        motor: KIND:NUMBERS.
        gear: turns of the motor per turn of the crank.
        friction: JOINT=VISCOUS,COULOMB each.
        spring: A:B=STIFFNESS,REST or JOINT=STIFFNESS,REST each.
        damper: A:B=DAMPING or JOINT=DAMPING each.
        flywheel: in [kg m2].
    """

    gravity: str
    load: str | None
    motor: str | None
    gear: float | None
    friction: Sequence[str]
    spring: Sequence[str]
    damper: Sequence[str]
    flywheel: float


def forces_of(drive: "ClosedForm", given: Given) -> "Forces":
    """Return the forces that options ask for."""
    from mechsim import units
    from mechsim.errors import InputError
    from mechsim.model.forces import Forces, Friction, JointSpring, Spring

    pull = units.parse_vector(given.gravity, "1", "--gravity")
    if len(pull) != 3:
        raise InputError(
            f"--gravity is {given.gravity!r}, {len(pull)} numbers; give three in m/s2, with commas"
        )
    if given.gear is not None and given.motor is None:
        raise InputError("--gear is the gear of a motor, and none is given; add --motor")
    made: dict[str, Any] = {} if given.load is None else loads_of(drive, given.load)
    sprung = [spring_of(text) for text in given.spring] + [damper_of(text) for text in given.damper]
    return Forces(
        gravity=(pull[0], pull[1], pull[2]),
        friction=(
            *(friction_of(text) for text in given.friction),
            *(one for one in sprung if isinstance(one, Friction)),
        ),
        springs=tuple(one for one in sprung if isinstance(one, Spring)),
        joint_springs=tuple(one for one in sprung if isinstance(one, JointSpring)),
        flywheel=given.flywheel,
        motor=None if given.motor is None else _geared(motor_of(given.motor), given.gear),
        **made,
    )


def _geared(motor: "PlainMotor", ratio: float | None) -> "Motor":
    from mechsim.model.motors import Geared

    return motor if ratio is None else Geared(motor, ratio)


def motor_of(text: str) -> "PlainMotor":
    """Return a motor written as KIND:NUMBERS."""
    from mechsim import units
    from mechsim.errors import InputError
    from mechsim.model import motors

    kind, _, rest = text.partition(":")
    parts = rest.split(",") if rest else []
    wanted = {"constant": 1, "line": 2, "dc": 3}.get(kind)
    if wanted != len(parts):
        raise InputError(f"--motor is {text!r}; write {', '.join(MOTORS.values())}")
    if kind == "line":
        stall = units.parse(parts[0], "1", "stall torque of --motor")
        return motors.TorqueSpeedLine(stall, units.parse_speed(parts[1], "no-load speed of --motor"))
    values = [units.parse(part, "1", "--motor") for part in parts]
    return motors.ConstantTorque(values[0]) if kind == "constant" else motors.DCMotor(*values)


def friction_of(text: str) -> "Friction":
    """Return friction written as JOINT=VISCOUS or JOINT=VISCOUS,COULOMB, in SI; of a sleeve four numbers."""
    from mechsim.model.forces import Friction

    joint, values = _named(text, "--friction", (1, 2, 4), "JOINT=VISCOUS,COULOMB", "crank=1e-4,2e-3")
    return Friction(joint, *values)


def spring_of(text: str) -> "Spring | JointSpring":
    """Return a spring written as A:B=STIFFNESS,REST between places, or JOINT=STIFFNESS,REST in a joint."""
    from mechsim.model.forces import JointSpring, Spring

    form = "A:B=STIFFNESS,REST or JOINT=STIFFNESS,REST"
    name, values = _named(text, "--spring", (1, 2), form, "P3:ground@0,0.1,0=500,0.05")
    if ":" in name:
        return Spring(*_places(name, "--spring"), *values)
    return JointSpring(name, *values)


def damper_of(text: str) -> "Spring | Friction":
    """Return a damper written as A:B=DAMPING between places, or JOINT=DAMPING in a joint."""
    from mechsim.model.forces import Friction, Spring

    form = "A:B=DAMPING or JOINT=DAMPING"
    name, values = _named(text, "--damper", (1,), form, "P3:ground@0,0.1,0=2")
    if ":" in name:
        return Spring(*_places(name, "--damper"), 0.0, 0.0, values[0])
    return Friction(name, values[0])


def _named(
    text: str, option: str, counts: tuple[int, ...], form: str, example: str
) -> tuple[str, tuple[float, ...]]:
    """Return the name and the numbers of an option written as NAME=NUMBERS."""
    from mechsim import units
    from mechsim.errors import InputError

    name, equals, rest = text.partition("=")
    values = units.parse_vector(rest, "1", option) if equals else ()
    if len(values) not in counts:
        raise InputError(f"{option} is {text!r}; write {form} in SI, as in {example}")
    return name.strip(), tuple(values)


def _places(text: str, option: str) -> "tuple[Place, Place]":
    """Return two places written as A:B; each a point, or LINK@X,Y,Z in the link's frame."""
    from mechsim import units
    from mechsim.errors import InputError

    def place(part: str) -> "Place":
        link, at, rest = part.strip().partition("@")
        if not at:
            return link
        x = units.parse_vector(rest, "m", option)
        if len(x) != 3:
            raise InputError(f"{option} has a place {part!r}; write LINK@X,Y,Z in m")
        return link, (x[0], x[1], x[2])

    first, _, second = text.partition(":")
    return place(first), place(second)


def loads_of(drive: "ClosedForm", path: str) -> dict[str, Any]:
    """Return loads from a table: angle [rad] or time [s]; P3.fx .. [N], LINK.mx .. [N m], crank [N m]."""
    from mechsim import files
    from mechsim.errors import InputError
    from mechsim.model.forces import Couple, Load
    from mechsim.model.load_profile import table

    columns = files.read(path)
    over = "angle" if "angle" in columns else "time"
    if over not in columns:
        raise InputError(
            f"{path!r} has no column angle [rad] or time [s] (it has {', '.join(columns)}); add one"
        )
    at = columns[over]
    points = dict.fromkeys(name.rsplit(".", 1)[0] for name in columns if ".f" in name)
    links = dict.fromkeys(name.rsplit(".", 1)[0] for name in columns if ".m" in name)
    known = {over, "crank", *(f"{point}.f{axis}" for point in points for axis in "xyz")}
    known |= {f"{link}.m{axis}" for link in links for axis in "xyz"}
    if strange := sorted(set(columns) - known):
        raise InputError(
            f"{path!r} has columns {', '.join(strange)}; loads are POINT.fx, POINT.fy, POINT.fz in N, "
            "LINK.mx, LINK.my, LINK.mz and crank in N m"
        )
    repeats = over == "angle" and drive.crank_range().full
    made: dict[str, Any] = {
        "loads": tuple(
            Load(point, table(at, _vectors(columns, f"{point}.f", len(at)), over=over, periodic=repeats))
            for point in points
        ),
        "couples": tuple(
            Couple(link, table(at, _vectors(columns, f"{link}.m", len(at)), over=over, periodic=repeats))
            for link in links
        ),
    }
    if "crank" in columns:
        made["crank_torque"] = table(at, columns["crank"], over=over, periodic=repeats)
    if not (points or links or "crank" in columns):
        raise InputError(f"{path!r} holds no load; add columns POINT.fx, POINT.fy, POINT.fz or crank")
    return made


def _vectors(columns: Mapping[str, "NDArray[np.float64]"], what: str, rows: int) -> "NDArray[np.float64]":
    import numpy as np

    return np.column_stack([columns.get(what + axis, np.zeros(rows)) for axis in "xyz"])
