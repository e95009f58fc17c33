"""Designs made together, with where their assembly begins: by a formula on arrays, or each by itself."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.catalog.many_designs import allowed, can_be_begun, started
from mechsim.errors import MechsimError
from mechsim.maths.arrays import Array
from mechsim.model.design_arrays import StartedDesigns, those_alike
from mechsim.model.forces import Forces
from mechsim.model.mechanism import Mechanism
from mechsim.studies.sweep.subject import Make
from mechsim.studies.sweep.task import SweepTask

Rows = NDArray[np.intp]


@dataclass(frozen=True)
class BegunDesigns:
    """Designs that are alike, and where they begin.

    Attributes:
        started: their numbers.
        which: of those asked for they are.
        mechanisms: themselves, where they are wanted whole; else none.
    """

    started: StartedDesigns
    which: Rows
    mechanisms: Sequence[Mechanism] = ()


def begun_designs(task: SweepTask, rows: Mapping[str, Array], *, whole: bool = False) -> BegunDesigns | None:
    """Return the designs that can be made and are alike; None where none is.

    Args:
        task: the sweep.
        rows: parameter -> its value in each design.
        whole: whether the mechanisms themselves are wanted, those on which other forces act left out.
    """
    form = task.subject.closed
    if form is not None and can_be_begun(form, rows):
        return _by_formula(form, rows, task.subject.make if whole else None)
    made = [*_made(task, rows)]
    started, which = those_alike(task.subject.form.mechanism, made)
    if started is None:
        return None
    return BegunDesigns(started, which, [one for i in which if (one := made[i]) is not None])


def _by_formula(form: ClosedForm, rows: Mapping[str, Array], make: Make | None) -> BegunDesigns | None:
    good = np.flatnonzero(allowed(form, rows))
    while len(good):
        begun = started(form, {name: one[good] for name, one in rows.items()})
        stands = np.all([np.isfinite(pose.rotation).all((1, 2)) for pose in begun.guess.values()], axis=0)
        if stands.all():
            made = [make(_row(rows, int(i))) for i in good] if make is not None else []
            return BegunDesigns(begun, good, [one.description for one in made if isinstance(one, ClosedForm)])
        good = good[stands]
    return None


def _row(rows: Mapping[str, Array], i: int) -> dict[str, float]:
    return {name: float(values[i]) for name, values in rows.items()}


def _made(task: SweepTask, rows: Mapping[str, Array]) -> Iterator[Mechanism | None]:
    """Yield designs; None for those that cannot be made, or on which other forces act."""
    for i in range(len(next(iter(rows.values())))):
        one = None
        with suppress(MechsimError, ArithmeticError, ValueError):
            form = task.subject.make(_row(rows, i))
            like = (getattr(form, "forces", None) or Forces()) == task.forces
            one = form.mechanism if like or not task.loaded else None
        yield one
