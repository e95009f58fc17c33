"""The catalogue: mechanisms described by models/NAME.toml, with their formulas in models/NAME.py."""

import difflib
import re
from collections.abc import Iterator, Mapping
from dataclasses import Field, field, fields, make_dataclass, replace
from functools import cache
from itertools import takewhile
from pathlib import Path
from typing import Any, cast

import numpy as np

from mechsim import units
from mechsim.analytic.formulas.base import ClosedForm
from mechsim.analytic.formulas.formulas import Formulas, Geometry, parameter_value
from mechsim.analytic.vector_method.vectors import column, cross
from mechsim.errors import InputError
from mechsim.files import read_text
from mechsim.model.expressions import Evaluator, Term, parse_expression
from mechsim.model.mechanism import Mechanism
from mechsim.model.quantity import AXES
from mechsim.numerics.arrays import Array
from mechsim.subjects.python_object import run_object
from mechsim.subjects.toml_coordinates import coordinates_of, drivers_of
from mechsim.subjects.toml_keys import ROOT
from mechsim.subjects.toml_reader import MAX_BYTES, mechanism_of
from mechsim.subjects.toml_values import TomlSource, Values, parsed_source
from mechsim.units import Unit

PACKAGE = Path(__file__).resolve().parents[1]
NAMES = ("four_bar", "slider_crank", "rssr", "rrsrr", "warp_knitter", "looper", "bennett")
# kind of a parameter -> its unit, and whether it must be positive
KINDS: dict[str, tuple[Unit, bool]] = {
    "length": ("m", True),
    "position": ("m", False),
    "angle": ("rad", False),
    "number": ("1", False),
}
# tables of a file that are no part of its description
OWN_TABLES = ("parameters", "when", "formula")


def models() -> Path:
    """Return the folder of the mechanisms that come with mechsim, in a package or in its sources."""
    inside = PACKAGE / "models"
    return inside if inside.is_dir() else PACKAGE.parent / "models"


def description_of(path: Path) -> str:
    """Return the first sentence of the comment at the head of a mechanism's file."""
    lines = path.read_text(encoding="utf-8").splitlines()
    head = takewhile(lambda line: line.startswith("# ") and not line.startswith("# Source:"), lines)
    text = " ".join(line.removeprefix("# ") for line in head)
    return re.split(r"[.;] ", text)[0].rstrip(".") + "."


class _Mechanisms(Mapping[str, type[ClosedForm]]):
    """Mechanisms by name; the file of one is read when it is asked for."""

    def __getitem__(self, name: str) -> type[ClosedForm]:
        if name not in NAMES:
            raise KeyError(name)
        return _mechanism(name)

    def __iter__(self) -> Iterator[str]:
        return iter(NAMES)

    def __len__(self) -> int:
        return len(NAMES)

    def __contains__(self, name: object) -> bool:
        return name in NAMES


MECHANISMS = _Mechanisms()


@cache
def _mechanism(name: str) -> type[ClosedForm]:
    """Return the formulas of a mechanism with the parameters and the description of its file."""
    path = models() / f"{name}.toml"
    source = parsed_source(str(path), read_text(str(path), "a TOML file", MAX_BYTES))
    formulas = cast(type[ClosedForm], run_object(source.sibling(source.document["formula"]["python"])))
    members = {
        "__doc__": description_of(path),
        "declaration": replace(formulas.declaration, name=name),
        "description": property(lambda self: _described(source, self)),
        "geometry": lambda self: _geometry(source, self),
    }
    parameters = [_parameter(key, row) for key, row in source.document["parameters"].items()]
    return make_dataclass(
        formulas.__name__, parameters, bases=(formulas,), namespace=members, frozen=True, kw_only=True
    )


def _parameter(name: str, row: Mapping[str, Any]) -> tuple[str, type, Any]:
    """Return name, type and declaration of a parameter from its row in a file."""
    unit, positive = KINDS[row.get("kind", "number")]
    rule = {"unit": unit, "doc": row["about"]} | ({"positive": True} if positive else {})
    value = row["value"]
    if "choices" in row:
        rule["options"] = tuple(row["choices"])
    elif isinstance(value, list):
        value = tuple(map(float, cast(list[float], value)))
    elif isinstance(value, str):
        value = units.parse(value, unit, name)
    elif unit != "1":
        value = float(value)
    return name, type(value), field(default=value, metadata=rule)


def _values(formulas: Formulas) -> dict[str, Any]:
    """Return the parameters by the names that expressions use; a component of a point is pivot_x."""
    values: dict[str, Any] = {}
    for parameter in fields(formulas):
        value = getattr(formulas, parameter.name)
        if isinstance(value, tuple):
            components = zip(AXES, cast(tuple[Any, ...], value), strict=False)
            values |= {f"{parameter.name}_{axis}": component for axis, component in components}
        elif not isinstance(value, str):
            values[parameter.name] = value
    return values


def _document(source: TomlSource, values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the description in a file; a table in `when` replaces joints where its choice is true."""
    document = {key: table for key, table in source.document.items() if key not in OWN_TABLES}
    for choice, tables in source.document.get("when", {}).items():
        if values[choice]:
            document |= {key: document[key] | table for key, table in tables.items()}
    return document


def _described(source: TomlSource, formulas: Formulas) -> Mechanism:
    """Return the description with the parameters of formulas, without a guess."""
    parameters = _values(formulas)
    values = Values(source, "m", "rad", parameters)
    read = values.checked(ROOT, _document(source, parameters), ())
    coordinates = coordinates_of(values, read)
    return mechanism_of(coordinates, drivers_of(coordinates, (), still=False))


def _geometry(source: TomlSource, formulas: Formulas) -> Geometry:
    """Return points and frames fixed in links; of many designs if parameters are arrays."""
    values = _values(formulas)
    if not any(getattr(value, "ndim", 0) for value in values.values()):
        return Formulas.geometry(formulas)
    document = _document(source, values)

    def vector(end: Mapping[str, Any], key: str) -> tuple[Any, ...]:
        return tuple(_number(entry, values) for entry in end.get(key, (0.0, 0.0, 0.0)))

    def frame(end: Mapping[str, Any]) -> Array:
        axis, reference = (column(vector(end, key)) for key in ("axis", "reference"))
        return np.stack(np.broadcast_arrays(reference, cross(axis, reference), axis), axis=1)

    joints = document["joints"]
    return Geometry(
        points={name: vector(entry, "at") for name, entry in document["points"].items()},
        joints={name: (vector(entry["a"], "at"), vector(entry["b"], "at")) for name, entry in joints.items()},
        frames={
            name: frame(entry["a"])
            for name, entry in joints.items()
            if {"axis", "reference"} <= entry["a"].keys() and _varies(entry["a"]["axis"])
        },
    )


def _varies(vector: list[Any]) -> bool:
    return any(isinstance(entry, str) for entry in vector)


def _number(entry: float | str, values: Mapping[str, Any]) -> Any:
    """Return a number of a file, or the value of its expression, an array for arrays of parameters."""
    if not isinstance(entry, str):
        return float(entry)
    return Evaluator(lambda name: Term(values[name])).evaluate(parse_expression(entry)).value


def make(name: str, /, **values: Any) -> ClosedForm:
    """Return a catalogue mechanism with some parameters changed from their defaults.

    Args:
        name: of the mechanism, such as "four_bar"; `mechsim.list()` has all.
        values: lengths in [m], angles in [rad], or text with a unit, such as "14mm"; named as the fields of
            the class.

    Raises:
        InputError: for an unknown name or parameter (with the nearest known one), or an invalid value.
    """
    fields_of = parameters(name)
    for parameter in values:
        if parameter not in fields_of:
            raise InputError(f"{name} has no parameter {parameter!r}{nearest(parameter, list(fields_of))}")
    return MECHANISMS[name](
        **{key: parameter_value(name, fields_of[key], key, value) for key, value in values.items()}
    )


def parameters(name: str) -> dict[str, Field[Any]]:
    """Return the parameters of a mechanism: name -> field, whose metadata has its unit and description.

    Raises:
        InputError: for an unknown name, with the nearest known one.
    """
    if str(name) not in MECHANISMS:
        raise InputError(f"there is no mechanism {name!r}{nearest(str(name), list(MECHANISMS))}")
    # the change-point policy comes last, since it is no dimension
    ordered = sorted(fields(MECHANISMS[name]), key=lambda field: field.name == "change_point")
    return {field.name: field for field in ordered}


def with_theory(theory: str) -> str:
    """Return the names of the mechanisms for which a theory exists, as text."""
    return ", ".join(
        name for name, mechanism in MECHANISMS.items() if theory in mechanism.declaration.theories
    )


# names that an error message lists
MAX_LISTED = 16


def nearest(name: str, names: list[str]) -> str:
    """Return the end of an error message: the most similar name, and all names, or how to list many."""
    close = difflib.get_close_matches(name, names)
    # of equally similar names the first is suggested
    similarity = {
        candidate: difflib.SequenceMatcher(None, candidate, name).ratio()
        for candidate in names
        if candidate in close
    }
    hint = f"; did you mean {max(similarity, key=similarity.__getitem__)!r}? " if similarity else "; "
    listed = ", ".join(names) if len(names) <= MAX_LISTED else "the names that `mechsim list` prints"
    return f"{hint}choose from {listed}"
