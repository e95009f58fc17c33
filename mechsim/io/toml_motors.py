"""Motors and actuators of a TOML file, on joints or between points: `[forces.motors.NAME]`."""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, get_args

from mechsim.errors import InputError
from mechsim.io.law_text import control_law, parse_motion_law
from mechsim.io.toml_springs import point_of
from mechsim.io.toml_values import KeyPath, Values, suggestion
from mechsim.mechanism.actuators import NO_LIMIT, Actuator
from mechsim.mechanism.forces import Location
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motors import Controller
from mechsim.units import Unit

# a number followed by the unit of a voltage, which is 1 in SI
_VOLTS = re.compile(r"(?<=[\d.])\s*V\b")
# kind of motor on a joint -> its required keys, and those that it may have
JOINT_MOTORS: dict[str, tuple[str, str]] = {
    "constant": ("torque", ""),
    "line": ("stall no_load", ""),
    "dc": ("voltage resistance constant", "inductance gear"),
    "pd": ("target proportional", "derivative"),
    "pid": ("target proportional integral", "derivative"),
    "expression": ("torque", ""),
    "general": ("", "joint gear control gain bias direct inflow start control_range state_range"),
}


def expression_controllers(values: Values, table: Mapping[str, Any]) -> Iterator[Controller]:
    """Yield the controllers of motors of kind "expression"."""
    for name, entry in table.get("motors", {}).items():
        if entry["kind"] == "expression":
            path = ("forces", "motors", name)
            _require_keys(values, entry, path)
            with values.source.error_context(path):
                yield Controller(entry["joint"], str(entry["torque"]))


def actuators_of(values: Values, mechanism: Mechanism, table: Mapping[str, Any]) -> Iterator[Actuator]:
    """Yield the motors of all other kinds as actuators."""
    for name, entry in table.get("motors", {}).items():
        path = ("forces", "motors", name)
        if entry["kind"] == "expression":
            continue
        _require_keys(values, entry, path)
        if entry["kind"] == "general":
            with values.source.error_context(path):
                yield _general(mechanism, name, entry)
            continue
        units = {
            coordinate: unit
            for joint in mechanism.joints
            for coordinate in joint.coordinates
            for unit in get_args(Unit)
            if unit == mechanism.unit(coordinate)
        }
        joint = entry.get("joint")
        if joint is not None and joint not in units:
            nearest = suggestion(joint, units)
            raise values.source.error((*path, "joint"), f"names coordinate {joint!r}{nearest}")
        with values.source.error_context(path):
            ends = None if joint else _ends(mechanism, entry)
            yield _motor(values, name, entry, ends, units[joint] if joint else "m", path)


def _ends(mechanism: Mechanism, entry: Mapping[str, Any]) -> tuple[Location, Location]:
    """Return the points a and b of a motor."""
    return point_of(mechanism, entry["a"]), point_of(mechanism, entry["b"])


def _require_keys(values: Values, entry: Mapping[str, Any], path: KeyPath) -> None:
    """Raise InputError for keys of another kind of motor on a joint, and for missing ones."""
    kind = entry["kind"]
    required, optional = (keys.split() for keys in JOINT_MOTORS[kind])
    if kind != "expression" and {"a", "b"} & {*entry}:
        required, optional = ["a", "b", *required], [key for key in optional if key != "joint"]
        others = ["force_range" if kind == "general" else "limit"]
    elif kind == "expression":
        required, others = ["joint", *required], []
    else:
        required = required if kind == "general" else ["joint", *required]
        others = ["rotor", "force_range" if kind == "general" else "limit"]
    require_motor_keys(values, entry, path, required, (*optional, *others))


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


def _motor(
    values: Values,
    name: str,
    entry: Mapping[str, Any],
    ends: tuple[Location, Location] | None,
    unit: Unit,
    path: KeyPath,
) -> Actuator:
    """Return a motor between two points, or on one coordinate with a unit, "m" or "rad"."""
    effort: Unit = "N" if unit == "m" else "N m"
    speed: Unit = "m/s" if unit == "m" else "rad/s"

    def number(key: str, key_unit: Unit) -> float:
        return values.quantity(entry[key], key_unit, (*path, key))

    gear = float(entry.get("gear", 1.0)) if entry["kind"] == "dc" else 1.0
    limits = NO_LIMIT
    if "limit" in entry:
        largest = number("limit", effort)
        limits = (-largest / abs(gear), largest / abs(gear))
    common: dict[str, Any] = {
        "name": name,
        "gear": {} if ends else {entry["joint"]: gear},
        "ends": ends,
        "pull": gear,
        "force_range": limits,
        "inertia": entry.get("rotor", 0.0),
    }
    match entry["kind"]:
        case "constant":
            return Actuator(bias=(number("torque", effort), 0.0, 0.0), **common)
        case "line":
            stall, no_load = number("stall", effort), number("no_load", speed)
            if not stall * no_load > 0.0:
                raise InputError(
                    f"motor {name} drives nothing: stall and no_load need the same sign; correct one"
                )
            return Actuator(bias=(stall, 0.0, -stall / no_load), **common)
        case "dc":
            return _direct_current(entry, common)
        case _:
            written = entry["target"]
            text = f"{written:.17g}+0*t" if not isinstance(written, str) else written
            law = parse_motion_law(
                text,
                f"motor {name}",
                unit,
                lambda: 0.0,
                default_unit=values.in_si(1.0, unit),
                parameters=values.parameters,
            )
            # a controller kp e + kd e' + ki w of the error e = target - q, with w' = e
            proportional, derivative = entry["proportional"], entry.get("derivative", 0.0)
            integral = entry.get("integral", 0.0)
            return Actuator(
                control=law,
                gain=(integral, 0.0, 0.0),
                bias=(0.0, -proportional, -derivative),
                direct=(proportional, derivative),
                inflow=(1.0, 0.0, -1.0, 0.0) if integral else None,
                **common,
            )


def _direct_current(entry: Mapping[str, Any], common: dict[str, Any]) -> Actuator:
    """Return a direct-current motor: L i' = U - R i - K w, torque K i; without L, i = (U - K w) / R."""
    resistance, constant = entry["resistance"], entry["constant"]
    inductance = entry.get("inductance", 0.0)
    for key in ("resistance", "constant"):
        if not entry[key] > 0.0:
            raise InputError(f"motor {common['name']} has a {key} of {entry[key]:g}; give one above 0")
    if not inductance >= 0.0:
        raise InputError(f"motor {common['name']} has an inductance of {inductance:g} H; give 0 or more")
    law = control_law(_VOLTS.sub("", str(entry["voltage"])), common["name"])
    if not inductance:
        derivative = -(constant**2) / resistance
        return Actuator(
            control=law, gain=(constant / resistance, 0.0, 0.0), bias=(0.0, 0.0, derivative), **common
        )
    inflow = (1.0 / inductance, -resistance / inductance, 0.0, -constant / inductance)
    return Actuator(control=law, gain=(constant, 0.0, 0.0), inflow=inflow, **common)


def _general(mechanism: Mechanism, name: str, entry: Mapping[str, Any]) -> Actuator:
    """Return an actuator in the form of `mechanism.actuators`, in SI."""
    stated = {key: entry[key] for key in ("gain", "bias", "direct", "inflow", "start") if key in entry}
    ranges: dict[str, Any] = {
        key: (float(entry[key][0]), float(entry[key][1]))
        for key in ("control_range", "state_range", "force_range")
        if key in entry
    }
    gear, acts = entry.get("gear", 1.0), dict[str, Any]()
    if "a" in entry:
        if isinstance(gear, dict):
            raise InputError(f"motor {name} acts between two points; give gear as a number")
        acts, gear = {"ends": _ends(mechanism, entry), "pull": gear}, {}
    elif not isinstance(gear, dict):
        if "joint" not in entry:
            raise InputError(
                f"motor {name} names no joint; give joint, points a and b, or gear as a table by coordinate"
            )
        gear = {entry["joint"]: gear}
    law = control_law(str(entry.get("control", "0")), name)
    others: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list | tuple) else value for key, value in stated.items()
    }
    return Actuator(name, gear, law, inertia=entry.get("rotor", 0.0), **acts, **others, **ranges)
