"""Springs of a TOML file, between points or in joints: linear, or with a law of length l and rate v."""

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from mechsim.errors import InputError
from mechsim.files import is_table
from mechsim.io.law_text import python_expression, quantity, time_function
from mechsim.io.toml_values import KeyPath, Values, shown, suggestion, tabled_function
from mechsim.mechanism.forces import Location, Spring, located
from mechsim.mechanism.links import ORIGIN
from mechsim.mechanism.mechanism import Mechanism
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
