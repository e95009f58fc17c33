"""The subject of a sweep: other processes receive it and make other designs of it."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

from mechsim.analytic.derivatives.dimensions import DesignFamily
from mechsim.analytic.formulas.closed_form import ClosedForm
from mechsim.analytic.solvers import KinematicSolver
from mechsim.model.links import Pose
from mechsim.model.mechanism import Mechanism
from mechsim.subjects.model_source import Prescription
from mechsim.subjects.prescription import with_written_guess, written_guess
from mechsim.subjects.python_object import PythonObject
from mechsim.subjects.readers import as_text, open_model, parametric_model
from mechsim.subjects.toml_reader import TomlModel

Make = Callable[[Mapping[str, float]], KinematicSolver]


@dataclass(frozen=True)
class OfToml:
    """Makes designs of a TOML file.

    Attributes:
        model: the file.
        fixed: parameter -> text or number in SI, for parameters that are set and do not vary.
        guess: as from `written_guess`.
        units: parameter -> SI unit.
    """

    model: TomlModel
    fixed: Mapping[str, str | float] = field(default_factory=dict[str, "str | float"])
    guess: Mapping[str, Pose] = field(default_factory=dict[str, Pose])
    units: Mapping[str, str] = field(default_factory=dict[str, str])

    def __call__(self, values: Mapping[str, float]) -> KinematicSolver:
        """Return a design."""
        changed = {name: as_text(value, self.units.get(name, "1")) for name, value in values.items()}
        solver = self.model.describe({**self.fixed, **changed}, Prescription()).solver
        return with_written_guess(solver, self.guess)


@dataclass(frozen=True)
class OfPython:
    """Makes designs by a function in a Python file; each process that makes designs runs the file.

    Attributes:
        model: FILE.py:FUNCTION.
        fixed: argument -> text, for arguments that are set and do not vary.
    """

    model: str
    fixed: Mapping[str, str | float] = field(default_factory=dict[str, "str | float"])

    def __call__(self, values: Mapping[str, float]) -> KinematicSolver:
        """Return a design."""
        changed = os.stat(self.model.rpartition(":")[0]).st_mtime_ns
        return _maker(self.model, changed)({**self.fixed, **values})


@lru_cache(maxsize=8)
def _maker(model: str, changed: int) -> Callable[[Mapping[str, str | float]], KinematicSolver]:
    """Return a function that makes designs by a Python file; the file runs once per modification time."""
    return PythonObject(model).make


@dataclass(frozen=True)
class SweptSubject:
    """A subject and the function that makes its designs.

    Attributes:
        name: as requested.
        solver: the nominal design.
        design_family: its parameters.
        make: makes a design from parameter -> value in SI; it can be sent to other processes.
        closed: the formulas whose own parameters vary; None for other subjects.
    """

    name: str
    solver: KinematicSolver
    design_family: DesignFamily
    make: Make
    closed: ClosedForm | None = None


def swept_subject(
    model: str | KinematicSolver | Mechanism, set: Mapping[str, str | float] | None = None, **options: Any
) -> SweptSubject:
    """Return the subject of a sweep.

    Args:
        model: as for `load`, or a solver.
        set: parameter -> its value, as for `load`.
        options: further arguments of `load`.

    Raises:
        InputError: as for `load`.
    """
    source = open_model(model)
    result = parametric_model(source, set, **options)
    solver = result.make({})
    name = model if isinstance(model, str) else solver.name
    current, plain = dict(set or {}), not any(options.values())
    if isinstance(source, PythonObject) and plain and source.parameters({}).dimensions:
        return SweptSubject(name, solver, result, OfPython(source.address, current))
    if solver.closed_form is not None:
        return SweptSubject(name, solver, result, result.make, solver.closed_form)
    if isinstance(source, TomlModel) and plain and solver.motion_laws.crank:
        unit_of = {dimension.name: dimension.unit for dimension in result.dimensions.values()}
        make = OfToml(source, current, written_guess(source), unit_of)
        return SweptSubject(name, solver, result, make)
    return SweptSubject(name, solver, result, result.make)
