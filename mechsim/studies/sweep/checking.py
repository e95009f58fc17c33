"""Some designs of a sweep measured again, each by itself, and judged against the other road."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from xarray import Dataset

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.analytic.forms import Form
from mechsim.errors import MechsimError
from mechsim.simulation.run import simulate
from mechsim.studies.sweep.designs import SEED
from mechsim.studies.sweep.roads import alone, facts_alone
from mechsim.studies.sweep.stepped_road import prescribed_motion, with_closed_start
from mechsim.studies.sweep.table import column_name
from mechsim.studies.sweep.task import BUILT, SweepTask
from mechsim.verdict.judge import crosscheck

# part of a measure's scale by which designs may be measured otherwise by themselves than together: both keep
# the equations to rounding, which conditioning magnifies; measured 1e-12
SAME = 1e-9
# the same where a crank swings: a pose at a dead centre is known to the square root of rounding only
SAME_AT_ENDS = 1e-6


@dataclass(frozen=True, slots=True)
class CheckedDesigns:
    """How designs of a sweep fared on the other road.

    Attributes:
        road: which that is, in words.
        count: how many were run.
        passed: how many of them agree.
        worst: the largest place error of any tracked point, in [m].
        failed: why the others do not, by their numbers in the sweep.
    """

    road: str
    count: int
    passed: int
    worst: float
    failed: dict[int, str]


def check_table(task: SweepTask, found: "Dataset", count: int) -> CheckedDesigns:
    """Measure random designs that were built again by themselves, and judge their motions by the other road.

    That is MuJoCo's poses for formulas and loop equations, and these for designs that were stepped.

    Args:
        task: the sweep.
        found: its result.
        count: how many at most.
    """
    built = np.flatnonzero(np.isin(found["outcome"].values.ravel().astype(str), BUILT))
    some = np.random.default_rng(SEED).choice(built, min(count, len(built)), replace=False)
    worst, failed = 0.0, dict[int, str]()
    for i in np.sort(some):
        row = task.designs.rows(int(i), int(i) + 1)
        try:
            form = task.subject.make({name: float(values[0]) for name, values in row.items()})
            far, why = _judged(task, form)
            worst, why = max(worst, far), why or _measured_otherwise(task, form, found, int(i))
        except MechsimError as error:
            why = str(error)
        if why:
            failed[int(i)] = why
    return CheckedDesigns(_other_road(task), len(some), len(some) - len(failed), worst, failed)


def _other_road(task: SweepTask) -> str:
    if task.settings is None:
        return "MuJoCo's poses"
    return "the formulas" if isinstance(task.subject.form, ClosedForm) else "the loop equations"


def _judged(task: SweepTask, form: Form) -> tuple[float, str]:
    """Return the largest place error between both roads, in [m], and why they do not agree; else nothing."""
    form = with_closed_start(form)
    asked = prescribed_motion(form, task.pace)
    if task.settings is None:
        run = simulate(form, samples=task.samples, method="pose", **asked)
    else:
        run = simulate(form, samples=task.intervals, method="step", settings=task.settings, **asked)
    motion = run.motion
    if isinstance(form, LoopForm):
        exact = form.solve_as(motion)
    else:
        exact = form.solve_along(motion.angle, motion.speed, motion.acceleration)
    verdict = crosscheck(run, exact)
    far = max(float(one.max()) for one in motion.place_errors(exact).values())
    return far, "" if verdict.passed else verdict.outcome


def _measured_otherwise(task: SweepTask, form: Form, found: "Dataset", i: int) -> str:
    """Return which measure a design by itself has otherwise than in the table; nothing where none."""
    values, outcome, _ = alone(task, form, facts_alone(task, form))
    same = SAME_AT_ENDS if outcome == "swings" else SAME
    scales = {"rad": 1.0, "m": form.mechanism.size, "rad/s": task.pace, "rad/s2": task.pace**2}
    scales |= {"m/s": form.mechanism.size * task.pace, "m/s2": form.mechanism.size * task.pace**2}
    for one in task.measures:
        there, own = float(found[column_name(one.name)].values.ravel()[i]), values[one.name]
        if not abs(there - own) <= same * (abs(own) + abs(scales.get(one.unit, 0.0))):
            return f"{one.name} is {there:.12g} in the table and {own:.12g} by itself"
    return ""
