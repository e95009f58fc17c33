"""The subject of a sweep: a mechanism and its parameters."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mechsim.analytic.designs import DesignFamily
from mechsim.analytic.formulas.closed_form import ClosedForm
from mechsim.analytic.solvers import KinematicSolver
from mechsim.model.mechanism import Mechanism
from mechsim.subjects.python_object import PythonObject
from mechsim.subjects.readers import open_model, parametric_model


@dataclass(frozen=True)
class SweptSubject:
    """A subject and its designs.

    Attributes:
        name: as requested.
        solver: the nominal design.
        design_family: its parameters, and the function that makes its designs.
        closed: the formulas whose own parameters vary; None for other subjects.
        unitless: whether its parameters state no units, as arguments of a function in a Python file.
    """

    name: str
    solver: KinematicSolver
    design_family: DesignFamily
    closed: ClosedForm | None
    unitless: bool


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
    designs = parametric_model(source, set, **options)
    solver = designs.make({})
    unitless = isinstance(source, PythonObject) and bool(source.parameters({}).dimensions)
    name = model if isinstance(model, str) else solver.name
    closed = None if unitless else solver.closed_form
    return SweptSubject(name, solver, designs, closed, unitless)
