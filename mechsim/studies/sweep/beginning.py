"""Designs made together, with where their assembly begins: by a formula on arrays, or each by itself."""

from collections.abc import Iterator, Mapping
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.catalog.many_designs import allowed, can_be_begun, started
from mechsim.errors import MechsimError
from mechsim.maths.arrays import Array
from mechsim.model.design_arrays import StartedDesigns, those_alike
from mechsim.model.mechanism import Mechanism
from mechsim.studies.sweep.task import SweepTask

Rows = NDArray[np.intp]


def begun_designs(task: SweepTask, rows: Mapping[str, Array]) -> tuple[StartedDesigns | None, Rows]:
    """Return the designs that can be made and are alike, and which those are; None where none is.

    Args:
        task: the sweep.
        rows: parameter -> its value in each design.
    """
    form = task.subject.closed
    if form is not None and can_be_begun(form, rows):
        return _by_formula(form, rows)
    return those_alike(task.subject.form.mechanism, _made(task, rows))


def _by_formula(form: ClosedForm, rows: Mapping[str, Array]) -> tuple[StartedDesigns | None, Rows]:
    good = np.flatnonzero(allowed(form, rows))
    if not len(good):
        return None, good
    begun = started(form, {name: one[good] for name, one in rows.items()})
    stands = np.all([np.isfinite(pose.rotation).all((1, 2)) for pose in begun.guess.values()], axis=0)
    if stands.all():
        return begun, good
    good = good[stands]
    return (started(form, {name: one[good] for name, one in rows.items()}) if len(good) else None), good


def _made(task: SweepTask, rows: Mapping[str, Array]) -> Iterator[Mechanism | None]:
    """Yield designs; None for those that cannot be made."""
    for i in range(len(next(iter(rows.values())))):
        one = None
        with suppress(MechsimError, ArithmeticError, ValueError):
            one = task.subject.make({name: float(values[i]) for name, values in rows.items()}).mechanism
        yield one
