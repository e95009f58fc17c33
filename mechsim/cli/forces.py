"""Text of the command line to forces: gravity, friction, motors, load tables."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mechsim.catalog.base import Drive
    from mechsim.forces import Forces, Friction
    from mechsim.motors import Motor

MOTORS = {
    "constant": "constant:TORQUE in N m",
    "line": "line:STALL in N m,NO-LOAD speed",
    "dc": "dc:VOLTAGE in V,RESISTANCE in ohm,CONSTANT in N m/A",
}


def forces_of(
    drive: "Drive",
    gravity: str,
    load: str | None,
    motor: str | None,
    friction: Sequence[str],
    flywheel: float,
) -> "Forces":
    """Return the forces that options ask for."""
    from mechsim import units
    from mechsim.errors import InputError
    from mechsim.forces import Forces

    pull = units.parse_vector(gravity, "1", "--gravity")
    if len(pull) != 3:
        raise InputError(f"--gravity is {gravity!r}, {len(pull)} numbers; give three in m/s2, with commas")
    made: dict[str, Any] = {} if load is None else loads_of(drive, load)
    return Forces(
        gravity=(pull[0], pull[1], pull[2]),
        friction=tuple(friction_of(text) for text in friction),
        flywheel=flywheel,
        motor=None if motor is None else motor_of(motor),
        **made,
    )


def motor_of(text: str) -> "Motor":
    """Return a motor written as KIND:NUMBERS."""
    from mechsim import motors, units
    from mechsim.errors import InputError

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
    """Return friction written as JOINT=VISCOUS or JOINT=VISCOUS,COULOMB, in SI."""
    from mechsim import units
    from mechsim.errors import InputError
    from mechsim.forces import Friction

    joint, equals, rest = text.partition("=")
    values = units.parse_vector(rest, "1", "--friction") if equals else ()
    if len(values) not in (1, 2):
        raise InputError(f"--friction is {text!r}; write JOINT=VISCOUS,COULOMB in SI, as in crank=1e-4,2e-3")
    return Friction(joint.strip(), *values)


def loads_of(drive: "Drive", path: str) -> dict[str, Any]:
    """Return loads from a table: angle [rad] or time [s], then P3.fx, P3.fy, P3.fz [N] or crank [N m]."""
    from mechsim import tables
    from mechsim.course import table
    from mechsim.errors import InputError
    from mechsim.forces import Load

    columns = tables.read(path)
    over = "angle" if "angle" in columns else "time"
    if over not in columns:
        raise InputError(
            f"{path!r} has no column angle [rad] or time [s] (it has {', '.join(columns)}); add one"
        )
    at = columns[over]
    points = dict.fromkeys(name.rsplit(".", 1)[0] for name in columns if ".f" in name)
    known = {over, "crank", *(f"{point}.f{axis}" for point in points for axis in "xyz")}
    if strange := sorted(set(columns) - known):
        raise InputError(
            f"{path!r} has columns {', '.join(strange)}; loads are POINT.fx, POINT.fy, POINT.fz in N and "
            "crank in N m"
        )
    repeats = over == "angle" and drive.crank_range().full
    made: dict[str, Any] = {
        "loads": tuple(
            Load(point, table(at, _vectors(columns, point, len(at)), over=over, periodic=repeats))
            for point in points
        )
    }
    if "crank" in columns:
        made["crank_torque"] = table(at, columns["crank"], over=over, periodic=repeats)
    if not points and "crank" not in columns:
        raise InputError(f"{path!r} holds no load; add columns POINT.fx, POINT.fy, POINT.fz or crank")
    return made


def _vectors(columns: Mapping[str, "NDArray[np.float64]"], point: str, rows: int) -> "NDArray[np.float64]":
    import numpy as np

    return np.column_stack([columns.get(f"{point}.f{axis}", np.zeros(rows)) for axis in "xyz"])
