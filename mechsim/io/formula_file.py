"""Files of mechanisms with formulas: a description in TOML whose parameters the formulas in Python share.

Each parameter is a table with its value, kind and meaning. The formulas are a class that `[formula]` names;
its file is run. Numbers are in m and rad. A table in `[when.CHOICE]` replaces that of a joint where the
choice is true.
"""

import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from mechsim import units
from mechsim.errors import InputError, MechsimError
from mechsim.io.model_source import ModelDescription, ModelSource, Parameters, Prescription
from mechsim.io.python_object import PythonObject, run_object, run_user_code
from mechsim.io.toml_coordinates import FileCoordinates
from mechsim.io.toml_keys import root
from mechsim.io.toml_reader import TomlModel, formula_path, mechanism_of, tables_in
from mechsim.io.toml_values import TomlSource, Values, head_comment, suggestion
from mechsim.kinematics.designs import Dimension
from mechsim.kinematics.formulas.closed_form import ClosedForm, Geometry
from mechsim.kinematics.formulas.parameters import FormulaParameter
from mechsim.kinematics.formulas.two_branch import CHANGE_POINT, TwoBranchForm
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.kinematics.vector_method.vectors import column, cross
from mechsim.mechanism.expressions import Evaluator, Term, parse_expression
from mechsim.mechanism.links import AXES
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import Array

# tables that such a file may have; the others state forces and motions, which follow from options
TABLES = ("name", "intended_use", "parameters", "links", "joints", "couplings", "points", "when", "formula")
# of these, the ones that are no description
OWN_TABLES = ("parameters", "when", "formula")
# kind of a parameter -> its unit
PARAMETER_UNITS: dict[str, units.Unit] = {"length": "m", "position": "m", "angle": "rad", "number": "1"}


@dataclass(frozen=True)
class FormulaDescription(ModelSource):
    """The description that formulas share with other methods, which solve it by its loop equations.

    Attributes:
        source: the parsed file.
        about: the first sentence of the file.
        rows: parameters by name; the policy at change points comes last, since it is no dimension.
    """

    source: TomlSource
    about: str
    rows: Mapping[str, FormulaParameter]

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return str(self.source.document.get("name", ""))

    def describe(self, changed: Mapping[str, str | float], prescription: Prescription) -> ModelDescription:
        """Return the mechanism by its loop equations, with some parameters changed.

        Raises:
            InputError: for a parameter that only the formulas use, and as `read`.
        """
        code = _formulas_address(self.source)
        document = {key: table for key, table in self.source.document.items() if key != "parameters"}
        words = set(re.findall(r"\w+", repr(document)))
        # choices that no table and no expression of the description uses
        alone = [name for name, row in self.rows.items() if row.is_choice and name not in words]
        for name in changed:
            if name in alone:
                raise InputError(
                    f"{self.name}: only the formulas use {name}; name {code} as the model, "
                    "or choose the assembly by --start"
                )
        values = self._values({name: str(value) for name, value in changed.items()})
        values = {name: self.rows[name].checked(self.name, value) for name, value in values.items()}
        fact = f"solved by its loop equations; only the formulas {code} use {', '.join(alone)}"
        solver = KinematicSolver(self.mechanism(values), _numbers(values), facts=(fact,) if alone else ())
        return ModelDescription(solver)

    def parameters(self, changed: Mapping[str, str | float]) -> Parameters:
        """Return the parameters that are single numbers."""
        values = self._values(changed)
        numbers = {
            name: Dimension(name, float(values[name]), row.unit, row.unit)
            for name, row in self.rows.items()
            if not (row.is_choice or isinstance(row.default, tuple))
        }
        return Parameters(numbers, intended_use=self.source.document.get("intended_use", ""))

    def read(self, changed: Mapping[str, Any]) -> dict[str, Any]:
        """Return parameters in SI from values or text with a unit.

        Raises:
            InputError: for an unknown parameter, with the nearest name, or text that is no value.
        """
        for name in changed:
            if name not in self.rows:
                raise InputError(f"{self.name} has no parameter {name!r}{suggestion(name, self.rows)}")
        return {name: self.rows[name].read(self.name, value) for name, value in changed.items()}

    def _values(self, changed: Mapping[str, Any]) -> dict[str, Any]:
        """Return all parameters in SI, with some changed from their defaults."""
        return {name: row.default for name, row in self.rows.items()} | self.read(changed)

    def description(self, changed: Mapping[str, Any]) -> tuple[dict[str, Any], Values]:
        """Return the description in the file, and its values with some parameters changed."""
        numbers = _numbers(self._values(changed))
        return self.document(numbers), Values(self.source, "m", "rad", numbers)

    def mechanism(self, values: Mapping[str, Any]) -> Mechanism:
        """Return the description for values of the parameters, without a guess."""
        numbers = _numbers(values)
        reader = Values(self.source, "m", "rad", numbers)
        coordinates = FileCoordinates(reader, reader.checked(root(), self.document(numbers), ()))
        with self.source.error_context(()):
            return mechanism_of(coordinates, coordinates.drivers((), still=False))

    def geometry(self, values: Mapping[str, Any]) -> Geometry:
        """Return points and frames fixed in links for values of which some are arrays, of many designs."""
        numbers = _numbers(values)
        document = self.document(numbers)

        def vector(end: Mapping[str, Any], key: str) -> tuple[Any, ...]:
            return tuple(_number(entry, numbers) for entry in end.get(key, (0.0, 0.0, 0.0)))

        def frame(end: Mapping[str, Any]) -> Array:
            axis, reference = (column(vector(end, key)) for key in ("axis", "reference"))
            return np.stack(np.broadcast_arrays(reference, cross(axis, reference), axis), axis=1)

        joints = document["joints"].items()
        return Geometry(
            points={name: vector(entry, "at") for name, entry in document["points"].items()},
            joints={name: (vector(entry["a"], "at"), vector(entry["b"], "at")) for name, entry in joints},
            frames={
                name: frame(entry["a"])
                for name, entry in joints
                # those that an expression gives
                if "reference" in entry["a"] and any(isinstance(x, str) for x in entry["a"].get("axis", ()))
            },
        )

    def document(self, numbers: Mapping[str, Any]) -> dict[str, Any]:
        """Return the description in the file; a table in `when` replaces joints where its choice is true."""
        document = {key: table for key, table in self.source.document.items() if key not in OWN_TABLES}
        for choice, tables in self.source.document.get("when", {}).items():
            if numbers[choice]:
                document |= {key: document.get(key, {}) | table for key, table in tables.items()}
        return document


@dataclass(frozen=True)
class FormulaFile(FormulaDescription):
    """A mechanism whose formulas solve its motion.

    Attributes:
        formulas: class of the formulas.
    """

    formulas: type[ClosedForm]

    def make(self, values: Mapping[str, Any]) -> KinematicSolver:
        """Return the mechanism with some parameters changed from their defaults, as in `read`."""
        return KinematicSolver.by_formula(self.formulas(self, self.read(values)))

    def describe(self, changed: Mapping[str, str | float], prescription: Prescription) -> ModelDescription:
        """Return the mechanism with some parameters changed."""
        return ModelDescription(self.make({name: str(value) for name, value in changed.items()}))

    def parameters(self, changed: Mapping[str, str | float]) -> Parameters:
        """Return none: the dimensions are those of the solver."""
        return Parameters(intended_use=self.source.document.get("intended_use", ""))


def open_toml(path: str) -> ModelSource:
    """Return the source of a TOML file. Data run no code: `with_formulas` names the formulas of a file.

    Raises:
        InputError: for a file that is no TOML.
    """
    source = (model := TomlModel(path)).source
    return description_in(source, ClosedForm) if tables_in(source.document, "parameters") else model


def with_formulas(model: Any) -> Any:
    """Return FILE.py:CLASS for a TOML file whose formulas solve its motion; any other model unchanged."""
    if not isinstance(model, str | os.PathLike) or not (path := os.fspath(model)).endswith(".toml"):
        return model
    source = TomlModel(path).source
    code = _formulas_address(source) if tables_in(source.document, "parameters") else ""
    return formula_path(source, code) if code else model


def open_python(address: str) -> ModelSource:
    """Return the source of FILE.py:OBJECT: its formulas with FILE.toml, or any other object.

    Raises:
        InputError: for formulas that cannot be used with their description.
    """
    path, _, _ = address.rpartition(":")
    described = os.path.splitext(path)[0] + ".toml"
    if not os.path.isfile(described):
        return PythonObject(address)
    source = TomlModel(described).source
    own = _formulas_address(source).rpartition(":")[0] == Path(path).name
    if not (own and tables_in(source.document, "parameters")):
        return PythonObject(address)
    mechanism = mechanism_in(source)
    run_user_code(path, lambda: _try_formulas(mechanism))
    return mechanism


def _formulas_address(source: TomlSource) -> str:
    """Return FILE.py:CLASS as the table `[formula]` has it; empty without one."""
    table = source.document.get("formula")
    address = cast(dict[str, Any], table).get("python") if isinstance(table, dict) else None
    return address if isinstance(address, str) else ""


def _try_formulas(mechanism: FormulaFile) -> None:
    """Solve one configuration, so that an error in the code of formulas is reported before any result."""
    with suppress(MechsimError):  # the command reports it
        solver = mechanism.make({})
        solver.solve([solver.mechanism.start])


def mechanism_in(source: TomlSource) -> FormulaFile:
    """Return a mechanism with formulas from its file.

    Raises:
        InputError: for invalid contents; names file, line, key and remedy.
    """
    address = _formulas_address(source)
    formulas = run_object(formula_path(source, address)) if address else None
    if not (isinstance(formulas, type) and issubclass(formulas, ClosedForm)):
        raise source.error(("formula",), "names no class of formulas, which parameters with tables need")
    described = description_in(source, formulas)
    return FormulaFile(source, described.about, described.rows, formulas)


def description_in(source: TomlSource, formulas: type[ClosedForm]) -> FormulaDescription:
    """Return the description that a file shares with its formulas.

    Raises:
        InputError: for invalid contents; names file, line, key and remedy.
    """
    for key in source.document.keys() - TABLES:
        raise source.error((key,), f"is not read in a file with formulas; it has {', '.join(TABLES)}")
    # a number, or the table of a parameter of formulas
    row = root()["properties"]["parameters"]["additionalProperties"]
    tables_of_parameters = {"type": "object", "additionalProperties": row["anyOf"][1]}
    values = Values(source, "m", "rad", {})
    rows = values.checked(tables_of_parameters, source.document["parameters"], ("parameters",))
    values.checked(root()["properties"]["formula"], source.document.get("formula", {}), ("formula",))
    parameters = {name: _parameter(source, formulas, name, row) for name, row in rows.items()}
    values = replace(values, parameters=_numbers({name: row.default for name, row in parameters.items()}))
    keys = {key: root()["properties"][key] for key in TABLES if key not in OWN_TABLES}
    choices = {"type": "object", "additionalProperties": {"type": "object", "properties": keys}}
    for choice in values.checked(choices, source.document.get("when", {}), ("when",)):
        if choice not in rows:
            raise source.error(("when", choice), f"is no parameter{suggestion(choice, rows)}")
    if issubclass(formulas, TwoBranchForm):
        parameters[CHANGE_POINT.name] = CHANGE_POINT
    return FormulaDescription(source, head_comment(source.path), parameters)


def _parameter(
    source: TomlSource, formulas: type[ClosedForm], name: str, row: Mapping[str, Any]
) -> FormulaParameter:
    """Return a parameter from its row in a file."""
    path = ("parameters", name)
    if not name.isidentifier() or hasattr(formulas, name):
        raise source.error(path, "cannot be the name of a parameter here; choose another one")
    kind = row.get("kind", "number")
    unit, value = PARAMETER_UNITS[kind], row["value"]
    with source.error_context(path):
        if "choices" in row:
            pass
        elif isinstance(value, tuple):
            if kind != "position" or len(cast(tuple[Any, ...], value)) not in (2, 3):
                raise source.error(path, "is a list; only a position can be one, of two or three numbers")
            value = tuple(units.si(entry, unit, name) for entry in cast(tuple[Any, ...], value))
        elif isinstance(value, str) or unit != "1":
            value = float(units.si(value, unit, name))
    return FormulaParameter(name, value, unit, row["about"], tuple(row.get("choices", ())), kind == "length")


def _numbers(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters by the names that expressions use; a component of a point is pivot_x."""
    numbers: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, tuple):
            pairs = zip(AXES, cast(tuple[Any, ...], value), strict=False)
            numbers |= {f"{name}_{axis}": component for axis, component in pairs}
        elif not isinstance(value, str):
            numbers[name] = value
    return numbers


def _number(entry: float | str, numbers: Mapping[str, Any]) -> Any:
    """Return a number of a file, or the value of its expression, an array for arrays of parameters."""
    if not isinstance(entry, str):
        return float(entry)
    return Evaluator(lambda name: Term(numbers[name])).evaluate(parse_expression(entry)).value
