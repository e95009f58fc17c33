"""Designs with their initial assembled poses: by a formula on arrays, or each by itself."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.catalog.many_designs import allowed, can_be_started, started
from mechsim.errors import MechsimError
from mechsim.model.design_arrays import StartedDesigns, those_alike
from mechsim.model.forces import Forces
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.studies.sweep.subject import Make
from mechsim.studies.sweep.task import SweepTask

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class AssembledDesigns:
    """Designs of equal topology with their initial poses.

    Attributes:
        started: their dimensions and poses as arrays.
        which: their indices in the requested designs.
        mechanisms: the mechanisms if requested, otherwise empty.
    """

    started: StartedDesigns
    which: Rows
    mechanisms: Sequence[Mechanism] = ()


def assembled_designs(
    task: SweepTask, rows: Mapping[str, Array], *, with_mechanisms: bool = False
) -> AssembledDesigns | None:
    """Return the designs that can be made and have equal topology; None if there are none.

    Args:
        task: the sweep.
        rows: parameter -> its value in each design.
        with_mechanisms: whether to return the mechanisms too, except those with other forces.
    """
    solver = task.subject.closed
    if solver is not None and can_be_started(solver, rows):
        return _by_formula(solver, rows, task.subject.make if with_mechanisms else None)
    mechanisms = [*_made(task, rows)]
    started, which = those_alike(task.subject.solver.mechanism, mechanisms)
    if started is None:
        return None
    return AssembledDesigns(
        started, which, [mechanism for i in which if (mechanism := mechanisms[i]) is not None]
    )


def _by_formula(solver: ClosedForm, rows: Mapping[str, Array], make: Make | None) -> AssembledDesigns | None:
    valid = np.flatnonzero(allowed(solver, rows))
    while len(valid):
        designs = started(solver, {name: values[valid] for name, values in rows.items()})
        assembled = np.all(
            [np.isfinite(pose.rotation).all((1, 2)) for pose in designs.guess.values()], axis=0
        )
        if assembled.all():
            solvers = [make(_row(rows, int(i))) for i in valid] if make is not None else []
            return AssembledDesigns(
                designs, valid, [solver.description for solver in solvers if isinstance(solver, ClosedForm)]
            )
        valid = valid[assembled]
    return None


def _row(rows: Mapping[str, Array], i: int) -> dict[str, float]:
    return {name: float(values[i]) for name, values in rows.items()}


def _made(task: SweepTask, rows: Mapping[str, Array]) -> Iterator[Mechanism | None]:
    """Yield designs; None for those that cannot be made or have other forces."""
    for i in range(len(next(iter(rows.values())))):
        mechanism = None
        with suppress(MechsimError, ArithmeticError, ValueError):
            solver = task.subject.make(_row(rows, i))
            same_forces = (solver.forces or Forces()) == task.forces
            mechanism = solver.mechanism if same_forces or not task.measures.loaded else None
        yield mechanism
