"""Springs, motors and actuators of a TOML file, in `[forces]`: between points or on joints."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from mechsim.errors import InputError
from mechsim.files import is_table
from mechsim.io.law_text import control_law, parse_motion_law, python_expression, quantity, time_function
from mechsim.io.toml_values import KeyPath, Values, shown, suggestion, tabled_function
from mechsim.mechanism.actuators import NO_LIMIT, Actuator
from mechsim.mechanism.forces import Location, Spring, located
from mechsim.mechanism.links import ORIGIN
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.motors import Controller
from mechsim.mechanism.nonlinear_springs import NonlinearSpring, SpringLaw
from mechsim.units import ALONG, Unit

Made = TypeVar("Made")
# a name that is no function
_NAME = re.compile(r"(?<![\w.])([^\W\d]\w*)(?![\w(])")
# value of the other variable at which the unit of an expression is checked
PROBE = 0.5


@dataclass(frozen=True)
class FileForces:
    """The forces in a file.

    Attributes:
        values: reader of the file's numbers.
        mechanism: the mechanism.
        table: the table `[forces]`, whose keys are checked.
    """

    values: Values
    mechanism: Mechanism
    table: Mapping[str, Any]

    def each(self, key: str, make: "Callable[[FileForces, str, Any, KeyPath], Made]") -> list[Made]:
        """Return what `make` returns for these forces, name, entry and key path of each in a table of them.

        An error names the key path.
        """
        made: list[Made] = []
        for name, entry in self.table.get(key, {}).items():
            path = ("forces", key, name)
            with self.values.source.error_context(path):
                made.append(make(self, name, entry, path))
        return made

    def point(self, entry: Any) -> Location:
        """Return a point by its name, or by a link and a point in its frame."""
        point: Location = entry if isinstance(entry, str) else (entry["link"], entry.get("at", ORIGIN))
        located(self.mechanism, point)
        return point

    def ends(self, entry: Mapping[str, Any]) -> tuple[Location, Location]:
        """Return the points a and b of a force."""
        return self.point(entry["a"]), self.point(entry["b"])

    def unit(self, coordinate: str, path: KeyPath) -> Unit:
        """Return the unit of a coordinate; raise InputError for an unknown one."""
        if coordinate not in self.mechanism.coordinates:
            hint = suggestion(coordinate, self.mechanism.coordinates)
            raise self.values.source.error((*path, "joint"), f"names coordinate {coordinate!r}{hint}")
        return self.mechanism.unit(coordinate)


def spring_of(file: FileForces, name: str, entry: Any, path: KeyPath) -> Spring | NonlinearSpring:
    """Return a spring between points, or one in a joint, with preload or with a law of its own."""
    between, in_joint = "a" in entry and "b" in entry, "joint" in entry
    if between == in_joint or (in_joint and ("a" in entry or "b" in entry)):
        reason = "needs two points a and b, or the coordinate of a joint; give either"
        raise file.values.source.error(path, reason)
    if not {"stiffness", "force"} & {*entry}:
        raise file.values.source.error(path, "has no 'stiffness' and no 'force'; give one, or both")
    if between and not {"force", "preload"} & {*entry}:
        return linear_spring(file, name, entry, path)
    unit = file.unit(entry["joint"], path) if in_joint else "m"
    ends = entry["joint"] if in_joint else file.ends(entry)
    constants = _constants(file.values, entry, unit, path)
    law = _force(file.values, entry.get("force", ""), unit, (*path, "force"))
    return NonlinearSpring(ends, SpringLaw(**constants, **law), name)


def linear_spring(file: FileForces, _: str, entry: Any, path: KeyPath) -> Spring:
    """Return a linear spring or damper between points."""
    constants = _constants(file.values, entry, "m", path)
    constants.pop("preload")
    return Spring(*file.ends(entry), **constants)


def _constants(values: Values, entry: Mapping[str, Any], unit: Unit, path: KeyPath) -> dict[str, float]:
    """Return the constants of a linear spring in SI; 0 for those that are not given."""
    along = ALONG[unit]
    units: dict[str, Unit] = {"rest": unit, "preload": along["force"]}
    units |= {key: along[key] for key in ("stiffness", "damping")}
    return {key: values.quantity(entry.get(key, 0.0), own, (*path, key)) for key, own in units.items()}


def _force(values: Values, text: str, unit: Unit, path: KeyPath) -> dict[str, Any]:
    """Return the expression of a law in SI, or its table."""
    if not text:
        return {}
    if is_table(text):
        table = tabled_function(values, text, path, ("l", "v"), "force")
        return {"table": table, "over": table.variable}
    scale, parameters = values.in_si(1.0, unit), values.parameters
    names = {match[1] for match in _NAME.finditer(text)}
    for name in names & {"l", "v"} & {*parameters}:
        raise values.source.error(path, f"names {name}, which is also a parameter; rename the parameter")
    variable, text = "l" if "l" in names else "v", re.sub(r"\bN\s+m\b", "N*m", text)
    others = {**parameters, **{name: PROBE for name in ("l", "v") if name != variable}}

    def in_si(match: re.Match[str]) -> str:
        """Return a variable in the units of the file, a parameter, or a unit in SI."""
        name = match[1]
        if name in ("l", "v"):
            return name if scale == 1.0 else f"({name}/{scale!r})"
        return name if name == "pi" or name in parameters else repr(float(quantity(f"1 {name}").value))

    try:
        time_function(text, "N" if unit == "m" else "N m", parameters=others, variable=variable)
        used = tuple(name for name in parameters if name in names)
        values_used = tuple(float(parameters[name]) for name in used)
        return {"text": _NAME.sub(in_si, python_expression(text)), "names": used, "values": values_used}
    except InputError as error:
        raise values.source.error(path, f"is {shown(text)}, which {error}") from None


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
