"""Verification of a sweep: random designs are measured again and compared with the other method."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from xarray import Dataset

from mechsim.analytic.catalog.base import ClosedForm
from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import MechsimError
from mechsim.simulation.run import simulate
from mechsim.studies.sweep.designs import SEED
from mechsim.studies.sweep.methods import facts_alone, measured_alone
from mechsim.studies.sweep.stepped_runs import prescribed_motion, with_closed_start
from mechsim.studies.sweep.table import column_name
from mechsim.studies.sweep.task import BUILT, SweepTask
from mechsim.verdict.judge import crosscheck

# largest difference, relative to a measure's scale, between a design measured alone and together: both
# satisfy the equations to rounding, which conditioning amplifies; measured 1e-12
RELATIVE_TOLERANCE = 1e-9
# the same for a crank that swings: a pose at a dead centre is accurate to the square root of rounding only
RELATIVE_TOLERANCE_AT_ENDS = 1e-6


@dataclass(frozen=True, slots=True)
class CheckedDesigns:
    """Result of a comparison of designs with the other method.

    Attributes:
        method: name of the other method.
        count: number of designs compared.
        passed: number of designs that agree.
        worst: the largest position error of any tracked point, in [m].
        failed: index in the sweep -> reason why the design does not agree.
    """

    method: str
    count: int
    passed: int
    worst: float
    failed: dict[int, str]


def check_table(task: SweepTask, result: "Dataset", count: int) -> CheckedDesigns:
    """Measure random built designs again, and compare their motions with the other method.

    The other method is MuJoCo's poses for formulas and loop equations, and these for stepped designs.

    Args:
        task: the sweep.
        result: its result.
        count: largest number of designs.
    """
    built = np.flatnonzero(np.isin(result["outcome"].values.ravel().astype(str), BUILT))
    selected = np.random.default_rng(SEED).choice(built, min(count, len(built)), replace=False)
    worst, failed = 0.0, dict[int, str]()
    for i in np.sort(selected):
        row = task.designs.rows(int(i), int(i) + 1)
        try:
            solver = task.subject.make({name: float(values[0]) for name, values in row.items()})
            distance, reason = _compared(task, solver)
            worst, reason = (
                max(worst, distance),
                reason or _measured_differently(task, solver, result, int(i)),
            )
        except MechsimError as error:
            reason = str(error)
        if reason:
            failed[int(i)] = reason
    return CheckedDesigns(_other_method(task), len(selected), len(selected) - len(failed), worst, failed)


def _other_method(task: SweepTask) -> str:
    if task.settings is None:
        return "MuJoCo's poses"
    return "the formulas" if isinstance(task.subject.solver, ClosedForm) else "the loop equations"


def _compared(task: SweepTask, solver: Form) -> tuple[float, str]:
    """Return the largest position error between both methods, in [m], and why they disagree, or ""."""
    solver = with_closed_start(solver)
    motion = prescribed_motion(solver, task.path_speed)
    if task.settings is None:
        run = simulate(solver, samples=task.samples, method="pose", **motion)
    else:
        run = simulate(solver, samples=task.intervals, method="step", settings=task.settings, **motion)
    motion = run.motion
    if isinstance(solver, LoopForm):
        exact = solver.solve_as(motion)
    else:
        exact = solver.solve_along(motion.angle, motion.speed, motion.acceleration)
    verdict = crosscheck(run, exact)
    distance = max(float(errors.max()) for errors in motion.place_errors(exact).values())
    return distance, "" if verdict.passed else verdict.outcome


def _measured_differently(task: SweepTask, solver: Form, result: "Dataset", i: int) -> str:
    """Return which measure of a single design differs from the table, or ""."""
    values, outcome, _ = measured_alone(task, solver, facts_alone(task, solver))
    tolerance = RELATIVE_TOLERANCE_AT_ENDS if outcome == "swings" else RELATIVE_TOLERANCE
    scales = {"rad": 1.0, "m": solver.mechanism.size, "rad/s": task.path_speed, "rad/s2": task.path_speed**2}
    scales |= {
        "m/s": solver.mechanism.size * task.path_speed,
        "m/s2": solver.mechanism.size * task.path_speed**2,
    }
    for measure in task.measures:
        tabulated, single = float(result[column_name(measure.name)].values.ravel()[i]), values[measure.name]
        if not abs(tabulated - single) <= tolerance * (abs(single) + abs(scales.get(measure.unit, 0.0))):
            return f"{measure.name} is {tabulated:.12g} in the table and {single:.12g} by itself"
    return ""
