"""Springs of a TOML file, between points or in joints: linear, or with a law of length l and rate v."""

import re
from collections.abc import Iterator, Mapping
from typing import Any

from mechsim.errors import InputError
from mechsim.files import is_table
from mechsim.io.law_text import python_expression, quantity, time_function
from mechsim.io.toml_values import KeyPath, Values, shown, suggestion, tabled_function
from mechsim.mechanism.forces import Location, Spring, located
from mechsim.mechanism.links import ORIGIN
from mechsim.mechanism.mechanism import Mechanism
from mechsim.mechanism.nonlinear_springs import NonlinearSpring, SpringLaw
from mechsim.units import Unit

# keys of a linear spring, with their units along a displacement and along an angle
_CONSTANTS: dict[str, tuple[Unit, Unit]] = {
    "stiffness": ("N/m", "N m/rad"),
    "rest": ("m", "rad"),
    "damping": ("N s/m", "N m s/rad"),
    "preload": ("N", "N m"),
}
# a name that is no function
_NAME = re.compile(r"(?<![\w.])([^\W\d]\w*)(?![\w(])")
# value of the other variable at which the unit of an expression is checked
PROBE = 0.5


def springs_of(values: Values, mechanism: Mechanism, table: Mapping[str, Any]) -> Iterator[Spring]:
    """Yield the linear springs and dampers between points."""
    for kind in ("springs", "dampers"):
        for name, entry in table.get(kind, {}).items():
            path: KeyPath = ("forces", kind, name)
            if kind == "springs" and _nonlinear(values, entry, path):
                continue
            with values.source.error_context(path):
                a, b = (point_of(mechanism, entry[side]) for side in "ab")
                constants = _constants(values, entry, "m", path)
                constants.pop("preload")
                yield Spring(a, b, **constants)


def nonlinear_springs_of(
    values: Values, mechanism: Mechanism, table: Mapping[str, Any]
) -> Iterator[NonlinearSpring]:
    """Yield the springs in joints, and those with preload or a law of their own."""
    units = {name: mechanism.unit(name) for joint in mechanism.joints for name in joint.coordinates}
    for name, entry in table.get("springs", {}).items():
        path: KeyPath = ("forces", "springs", name)
        if not _nonlinear(values, entry, path):
            continue
        joint = entry.get("joint")
        if joint is not None and joint not in units:
            raise values.source.error(
                (*path, "joint"), f"names coordinate {joint!r}{suggestion(joint, units)}"
            )
        with values.source.error_context(path):
            ends = joint or (point_of(mechanism, entry["a"]), point_of(mechanism, entry["b"]))
            unit: Unit = "m" if joint is None or units[joint] == "m" else "rad"
            constants, force = _constants(values, entry, unit, path), entry.get("force", "")
            law = SpringLaw(**constants, **_force(values, force, unit, (*path, "force")))
            yield NonlinearSpring(ends, law, name)


def point_of(mechanism: Mechanism, entry: Any) -> Location:
    """Return a point by its name, or by a link and a point in its frame."""
    point: Location = entry if isinstance(entry, str) else (entry["link"], entry.get("at", ORIGIN))
    located(mechanism, point)
    return point


def _nonlinear(values: Values, entry: Mapping[str, Any], path: KeyPath) -> bool:
    """Return whether a spring is more than a linear one between points; raise InputError for missing keys."""
    between, joint = "a" in entry and "b" in entry, "joint" in entry
    if between == joint or (joint and ("a" in entry or "b" in entry)):
        raise values.source.error(path, "needs two points a and b, or the coordinate of a joint; give either")
    if not {"stiffness", "force"} & {*entry}:
        raise values.source.error(path, "has no 'stiffness' and no 'force'; give one, or both")
    return joint or bool({"force", "preload"} & {*entry})


def _constants(values: Values, entry: Mapping[str, Any], unit: Unit, path: KeyPath) -> dict[str, float]:
    """Return the constants of a linear spring in SI; 0 for those that are not given."""
    return {
        key: values.quantity(entry.get(key, 0.0), units[unit == "rad"], (*path, key))
        for key, units in _CONSTANTS.items()
    }


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
