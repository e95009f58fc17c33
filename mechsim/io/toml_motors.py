"""Motors and actuators of a TOML file, on joints or between points: `[forces.motors.NAME]`."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from mechsim.errors import InputError
from mechsim.io.law_text import control_law, parse_motion_law
from mechsim.io.toml_springs import FileForces
from mechsim.io.toml_values import KeyPath, Values
from mechsim.mechanism.actuators import NO_LIMIT, Actuator
from mechsim.mechanism.forces import Location
from mechsim.mechanism.motors import Controller
from mechsim.units import ALONG, Unit

# a number followed by the unit of a voltage, which is 1 in SI
_VOLTS = re.compile(r"(?<=[\d.])\s*V\b")
# settings of a motor of kind "general"
_SETTINGS = ("gain", "bias", "direct", "inflow", "start", "control_range", "state_range", "force_range")
# kind of motor -> its required keys, and those that it may have
JOINT_MOTORS: dict[str, tuple[str, str]] = {
    "constant": ("joint torque", "rotor limit"),
    "line": ("joint stall no_load", "rotor limit"),
    "dc": ("joint voltage resistance constant", "inductance gear rotor limit"),
    "pd": ("joint target proportional", "derivative rotor limit"),
    "pid": ("joint target proportional integral", "derivative rotor limit"),
    "expression": ("joint torque", ""),
    "general": ("", f"joint rotor gear control {' '.join(_SETTINGS)}"),
}


def motor_of(file: FileForces, name: str, entry: Any, path: KeyPath) -> Actuator | Controller:
    """Return a motor as an actuator; one of kind "expression" as a controller."""
    values, kind = file.values, entry["kind"]
    required, optional = (keys.split() for keys in JOINT_MOTORS[kind])
    between = kind != "expression" and bool({"a", "b"} & {*entry})
    if between:
        required = ["a", "b", *(key for key in required if key != "joint")]
        optional = [key for key in optional if key not in ("joint", "rotor")]
    require_motor_keys(values, entry, path, required, optional)
    if kind == "expression":
        return Controller(entry["joint"], str(entry["torque"]))
    ends = file.ends(entry) if between else None
    if kind == "general":
        return _general(name, entry, ends)
    unit = "m" if between else file.unit(entry["joint"], path)
    gear, limits = float(entry.get("gear", 1.0)), NO_LIMIT
    if "limit" in entry:
        largest = values.quantity(entry["limit"], ALONG[unit]["force"], (*path, "limit"))
        limits = (-largest / abs(gear), largest / abs(gear))
    common: dict[str, Any] = {
        "name": name,
        "gear": {} if between else {entry["joint"]: gear},
        "ends": ends,
        "pull": gear,
        "force_range": limits,
        "inertia": entry.get("rotor", 0.0),
    }
    if kind == "dc":
        return Actuator(**common, **_direct_current(name, entry))
    return Actuator(**common, **_law(values, name, entry, unit, path))


def require_motor_keys(
    values: Values, entry: Mapping[str, Any], path: KeyPath, required: Sequence[str], optional: Sequence[str]
) -> None:
    """Raise InputError for a motor without a required key, or with one that is not of its kind."""
    kind = entry["kind"]
    for key in required:
        if key not in entry:
            reason = f"is of kind {kind!r} and has no {key!r}; give {', '.join(required)}"
            raise values.source.error(path, reason)
    for key in entry:
        if key not in ("kind", *required, *optional):
            raise values.source.error((*path, key), f"does not go with kind {kind!r}; leave it out")


def _law(values: Values, name: str, entry: Mapping[str, Any], unit: Unit, path: KeyPath) -> dict[str, Any]:
    """Return the law of a constant effort, a line, or a pd or pid controller, on a coordinate with a unit."""

    def number(key: str, quantity: str) -> float:
        return values.quantity(entry[key], ALONG[unit][quantity], (*path, key))

    if entry["kind"] == "constant":
        return {"gain": (0.0, 0.0, 0.0), "bias": (number("torque", "force"), 0.0, 0.0)}
    if entry["kind"] == "line":
        stall, no_load = number("stall", "force"), number("no_load", "rate")
        if not stall * no_load > 0.0:
            raise InputError(
                f"motor {name} drives nothing: stall and no_load need the same sign; correct one"
            )
        return {"gain": (0.0, 0.0, 0.0), "bias": (stall, 0.0, -stall / no_load)}
    written = entry["target"]
    text = written if isinstance(written, str) else f"{written:.17g}+0*t"
    scale, names = values.in_si(1.0, unit), values.parameters
    law = parse_motion_law(text, f"motor {name}", unit, lambda: 0.0, default_unit=scale, parameters=names)
    # a controller kp e + kd e' + ki w of the error e = target - q, with w' = e
    proportional, derivative = entry["proportional"], entry.get("derivative", 0.0)
    integral = entry.get("integral", 0.0)
    return {
        "control": law,
        "gain": (integral, 0.0, 0.0),
        "bias": (0.0, -proportional, -derivative),
        "direct": (proportional, derivative),
        "inflow": (1.0, 0.0, -1.0, 0.0) if integral else None,
    }


def _direct_current(name: str, entry: Mapping[str, Any]) -> dict[str, Any]:
    """Return a direct-current motor: L i' = U - R i - K w, torque K i; without L, i = (U - K w) / R."""
    resistance, constant = entry["resistance"], entry["constant"]
    inductance = entry.get("inductance", 0.0)
    for key in ("resistance", "constant"):
        if not entry[key] > 0.0:
            raise InputError(f"motor {name} has a {key} of {entry[key]:g}; give one above 0")
    if not inductance >= 0.0:
        raise InputError(f"motor {name} has an inductance of {inductance:g} H; give 0 or more")
    law = {"control": control_law(_VOLTS.sub("", str(entry["voltage"])), name)}
    if not inductance:
        by_speed = -(constant**2) / resistance
        return {**law, "gain": (constant / resistance, 0.0, 0.0), "bias": (0.0, 0.0, by_speed)}
    inflow = (1.0 / inductance, -resistance / inductance, 0.0, -constant / inductance)
    return {**law, "gain": (constant, 0.0, 0.0), "inflow": inflow}


def _general(name: str, entry: Mapping[str, Any], ends: tuple[Location, Location] | None) -> Actuator:
    """Return an actuator in the form of `mechanism.actuators`, in SI."""
    gear, by_coordinate = entry.get("gear", 1.0), isinstance(entry.get("gear"), dict)
    if ends and by_coordinate:
        raise InputError(f"motor {name} acts between two points; give gear as a number")
    if not (ends or by_coordinate or "joint" in entry):
        raise InputError(
            f"motor {name} names no joint; give joint, points a and b, or gear as a table by coordinate"
        )
    acts = {"gear": {}, "ends": ends, "pull": gear}
    if not ends:
        acts = {"gear": gear if by_coordinate else {entry["joint"]: gear}}
    law = control_law(str(entry.get("control", "0")), name)
    settings: dict[str, Any] = {key: entry[key] for key in _SETTINGS if key in entry}
    return Actuator(name, control=law, inertia=entry.get("rotor", 0.0), **acts, **settings)
