"""The converged motion of a scene: the limit of smaller steps and less compliant loops, with its own error.

Contacts, limits, friction, actuators and springs are those of the file. The time constant of the loops
decreases with the step, and so does the loop-closure error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from mechsim.numerics.arrays import worst
from mechsim.numerics.convergence import plausible_order, refine
from mechsim.numerics.resources import Budget, Progress, no_progress
from mechsim.simulation.driven_run import stiffness_cause
from mechsim.simulation.plain_settings import LOWEST_COMPLIANCE_SOLIMP, PlainSettings
from mechsim.studies.scene.errors import By, SceneEvaluator, cubic_interpolation, deviation
from mechsim.studies.scene.run import SceneRun, run_scene
from mechsim.studies.scene.scene import UserScene

# smallest and largest number of steps of a run; each run has twice as many as the one before
MIN_STEPS, MAX_STEPS = 2000, 400_000
# integrators in the order of trial; the last integrates stiffness implicitly
INTEGRATORS = ("RK4", "implicitfast", "discrete")
# solver tolerance relative to that of the scene
SOLVER_TOLERANCE_RATIO = 1e-4
# number of records of each run
RECORDED = 2000
# time constant of the loops in steps
TIME_CONSTANT_STEPS = 10.0


@dataclass(frozen=True)
class ConvergedReference:
    """The converged motion of a scene.

    Attributes:
        run: the finest run.
        errors: its own error, estimated from three runs: of points in [m], of forces in [N m] or [N].
        order: order of convergence of the points; None for fewer than three runs.
        what: description of the run.
        broken: reason for a missing converged motion; empty otherwise.
    """

    run: SceneRun
    errors: tuple[float, float] = (np.inf, np.inf)
    order: float | None = None
    what: str = ""
    broken: str = ""

    @property
    def converged_run(self) -> SceneRun | None:
        """The finest run; None if there is no converged motion."""
        return None if self.broken else self.run

    @property
    def estimate(self) -> float:
        """The error of its points, in [m]."""
        return self.errors[0]

    def evaluator(self, measure: By) -> SceneEvaluator:
        """Return the evaluator of the errors of other runs of the scene."""
        return SceneEvaluator(self.converged_run, forces=measure == "torque")

    def error(self, measure: By) -> float:
        """Return its own error by a measure, in the unit of the measure."""
        return {"closure": 0.0, "trajectory": self.errors[0], "torque": self.errors[1]}[measure]


def hardened(
    model: mujoco.MjModel, timestep: float, integrator: str, tolerance: float = 1e-12
) -> mujoco.MjModel:
    """Return a copy of a model with another step and the least compliant loops that MuJoCo accepts."""
    option = model.opt
    return PlainSettings(
        timestep=timestep,
        integrator=integrator,
        solver="Newton",
        iterations=max(option.iterations, 100),
        ls_iterations=max(option.ls_iterations, 50),
        tolerance=min(option.tolerance, tolerance) or tolerance,
        solref=(TIME_CONSTANT_STEPS * timestep, 1.0),
        solimp=LOWEST_COMPLIANCE_SOLIMP,
    ).applied(model)


def compute_reference(
    scene: UserScene,
    tolerance: float = 0.0,
    *,
    budget: float | Budget = 10.0,
    progress: Progress = no_progress,
) -> ConvergedReference:
    """Return the converged motion of a scene.

    Args:
        scene: the scene.
        tolerance: error of its points in [m] at which refinement stops; 0 refines up to the budget.
        budget: approximate time for each integrator, in [s].
        progress: callback before each run.
    """
    own = scene.duration / float(scene.model.opt.timestep)
    first = int(np.ceil(np.clip(2.0 * own, MIN_STEPS, MAX_STEPS / 4)))
    best: ConvergedReference | None = None
    for integrator in INTEGRATORS:
        finest = hardened(scene.model, 4.0 * scene.duration / MAX_STEPS, integrator)
        if integrator != INTEGRATORS[-1] and stiffness_cause(finest):
            continue
        time = budget.share(1.0) if isinstance(budget, Budget) else Budget(budget)
        reference = _refined(scene, first, integrator, tolerance, time, progress)
        if best is None or (best.broken and not reference.broken) or reference.errors[0] < best.errors[0]:
            best = reference
        if not best.broken:
            break
    assert best is not None
    return best


def _refined(
    scene: UserScene, steps: int, integrator: str, tolerance: float, budget: Budget, progress: Progress
) -> ConvergedReference:
    """Return the converged motion by one integrator, with doubled steps up to the tolerance or budget."""
    runs: list[SceneRun] = []
    solver_tolerance = SOLVER_TOLERANCE_RATIO * scene.solver_tolerance
    start = budget.spent

    def attempt(steps: int) -> ConvergedReference:
        nonlocal start
        progress(f"limit: {integrator}, {steps:,} steps", 0.0)
        start = budget.spent
        model = hardened(scene.model, scene.duration / steps, integrator, solver_tolerance)
        run = run_scene(scene, model, records=RECORDED, phase=0.5)
        runs[:] = [] if run.broken else [*runs[-2:], run]
        if len(runs) == 3:
            return _extrapolated(runs, integrator)
        return ConvergedReference(run, broken=run.broken or "fewer than three runs")

    def following(steps: int, _: ConvergedReference) -> int | None:
        # the next run takes twice as long as the last
        has_time = 0 < len(runs) < 3 or 2.0 * (budget.spent - start) < budget.remaining
        return 2 * steps if has_time and 2 * steps <= MAX_STEPS else None

    return refine(attempt, steps, following, tolerance).best


def _extrapolated(runs: Sequence[SceneRun], integrator: str) -> ConvergedReference:
    """Return the finest of three runs with its error; each run has twice the steps of the one before."""
    coarse, middle, fine = runs
    changes = [
        (
            worst(np.linalg.norm(deviation(run, finer), axis=2)),
            worst(run.forces - cubic_interpolation(finer.time, finer.forces, run.time)),
        )
        for run, finer in ((coarse, middle), (middle, fine))
    ]
    orders = [plausible_order(before, last, 2.0) for before, last in zip(*changes, strict=True)]
    points, forces = (last / (2.0**order - 1.0) for last, order in zip(changes[1], orders, strict=True))
    what = f"{fine.steps:,} steps of {integrator}, loops with time constants of {TIME_CONSTANT_STEPS:g} steps"
    return ConvergedReference(fine, (points, forces), orders[0], what)
