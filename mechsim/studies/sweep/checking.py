"""Some designs of a sweep through the other road: MuJoCo's poses, judged against what was measured by."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from xarray import Dataset

from mechsim.analytic.closure.loop_form import LoopForm
from mechsim.errors import MechsimError
from mechsim.simulation.run import simulate
from mechsim.studies.motion_source import programs_of
from mechsim.studies.sweep.designs import SEED
from mechsim.studies.sweep.task import SweepTask
from mechsim.verdict.judge import crosscheck


@dataclass(frozen=True, slots=True)
class CheckedDesigns:
    """How designs of a sweep fared on the other road.

    Attributes:
        count: how many were run.
        passed: how many of them agree.
        worst: the largest place error of any tracked point, in [m].
        failed: why the others do not, by their numbers in the sweep.
    """

    count: int
    passed: int
    worst: float
    failed: dict[int, str]


def check_table(task: SweepTask, found: "Dataset", count: int) -> CheckedDesigns:
    """Run random designs that were built through MuJoCo, pose by pose, and judge them.

    Args:
        task: the sweep.
        found: its result.
        count: how many at most.
    """
    built = np.flatnonzero(found["outcome"].values.ravel() == "met")
    some = np.random.default_rng(SEED).choice(built, min(count, len(built)), replace=False)
    passed, worst, failed = 0, 0.0, dict[int, str]()
    for i in np.sort(some):
        row = task.designs.rows(int(i), int(i) + 1)
        try:
            form = task.subject.make({name: float(values[0]) for name, values in row.items()})
            programs = programs_of(form)
            asked = {"speed": task.pace} if programs is None else {"programs": programs}
            motion = simulate(form, samples=task.samples, method="pose", **asked).motion  # pyright: ignore[reportArgumentType]
            if isinstance(form, LoopForm):
                exact = form.solve_as(motion)
            else:
                exact = form.solve(motion.angle, motion.speed, motion.acceleration)
            verdict = crosscheck(motion, exact)
            worst = max(worst, *(float(one.max()) for one in motion.place_errors(exact).values()))
            passed += verdict.passed
            if not verdict.passed:
                failed[int(i)] = verdict.outcome
        except MechsimError as error:
            failed[int(i)] = str(error)
    return CheckedDesigns(len(some), passed, worst, failed)
