"""Longer time steps with refitted inertias, dampers, springs, constraints and servos.

A longer step changes the motion: light bodies jump, constraints yield, servos react late. Fitted parameters
compensate for most of this. The fit uses two motions; a third one verifies it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import process_time

import mujoco
import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.simulation.mjcf.silence import quiet
from mechsim.studies.reduction.candidate import Candidate
from mechsim.studies.reduction.evaluator import Evaluator
from mechsim.studies.reduction.evidence import Evidence
from mechsim.studies.reduction.model_parameters import Parameter, parameters_of, set_in_spec, with_parameters
from mechsim.studies.reduction.reduced_scene import ReducedScene
from mechsim.studies.reduction.stepping import (
    EULER,
    IMPLICITFAST,
    INTEGRATOR_NAMES,
    LONGER_STEPS,
    set_longer_steps,
)
from mechsim.studies.scenes.scene_run import stepped

# processor time of one fit, in [s]
SECONDS = 30.0
# iterations between checks; relative reduction of the sum of squares that they must achieve
MAX_ITERATIONS, MIN_COST_REDUCTION = 6, 0.1
# difference step of a parameter for the Jacobian; residual of a run that diverged, in tolerances
DIFFERENCE_STEP, DIVERGED_RESIDUAL = 1e-6, 1e3
# smallest effect of a unit change of a parameter that counts, in tolerances
MIN_EFFECT = 0.05
# fraction of the tolerance at which the fit stops
GOAL = 0.3
INTEGRATORS = (int(EULER), int(IMPLICITFAST))


@dataclass(frozen=True)
class Refit:
    """Longer steps and the parameters fitted to them.

    Attributes:
        candidate: the change of the scene.
        error: largest over the fitted motions, in [m].
        values: parameter -> fitted value; the start for still longer steps.
    """

    candidate: Candidate
    error: float
    values: dict[Parameter, float]


@quiet()
def refit(
    evaluators: Sequence[Evaluator], observed: Evidence, times: int, start: Mapping[Parameter, float]
) -> Refit | None:
    """Return longer steps for a scene with parameters fitted so that the motion stays the same.

    Args:
        evaluators: of the full scene over the fitted motions.
        observed: of the scene with its own steps.
        times: ratio of the new step to the scene's own.
        start: parameter -> initial value; 0 for parameters not named.

    Returns:
        None if the fit takes too long, or no parameter has an effect.
    """
    fits: list[_Fit] = []
    for kind in INTEGRATORS:
        spec = observed.spec.copy()
        set_longer_steps(spec, times, kind)
        fits.append(_Fit(evaluators, spec, observed, start))
    # the median, since light bodies jump at the start with any integrator
    best = min(fits, key=lambda fit: float(np.median(np.abs(fit.residuals(fit.start)))))
    if best.seconds > SECONDS or not best.drop_ineffective():
        return None
    values, worst = best.fitted()
    step, own = float(observed.spec.option.timestep), INTEGRATOR_NAMES[int(observed.spec.option.integrator)]
    kind = int(best.spec.option.integrator)
    what = (
        f"steps of {step:g} s, {own}: {step * times:g} s, {INTEGRATOR_NAMES[kind]}, and "
        f"{len(best.parameters)} fitted parameters of inertia, dampers, springs, constraints and servos"
    )
    edit = partial(_refitted, times=times, integrator=kind, parameters=best.parameters, values=values)
    values_of = dict(zip(best.parameters, values.tolist(), strict=True))
    return Refit(Candidate(LONGER_STEPS, what, edit), worst * observed.tolerance, values_of)


def _refitted(
    spec: mujoco.MjSpec, times: int, integrator: int, parameters: Sequence[Parameter], values: Array
) -> None:
    set_longer_steps(spec, times, integrator)
    set_in_spec(spec, parameters, values)


class _Fit:
    """Least-squares fit of a scene's parameters to the full scene's motion."""

    def __init__(
        self,
        evaluators: Sequence[Evaluator],
        spec: mujoco.MjSpec,
        observed: Evidence,
        start: Mapping[Parameter, float],
    ):
        self.spec, self.tolerance = spec, observed.tolerance
        self.runs = [(evaluator, evaluator.scene(spec)) for evaluator in evaluators]
        self.parameters = parameters_of(spec, self.runs[0][1], observed.limited)
        self.start = np.array([start.get(parameter, 0.0) for parameter in self.parameters])
        began = process_time()
        self.residuals(self.start)
        # of a round of iterations
        self.seconds = MAX_ITERATIONS * len(self.parameters) * (process_time() - began)

    def drop_ineffective(self) -> bool:
        """Drop parameters without effect at the start; return whether any remains."""
        if not self.parameters:
            return False
        effects = np.abs(self._jacobian(self.start)).max(0) > MIN_EFFECT
        self.parameters = tuple(
            parameter for parameter, effective in zip(self.parameters, effects, strict=True) if effective
        )
        self.start = self.start[effects]
        return bool(effects.any())

    def fitted(self) -> tuple[Array, float]:
        """Return the best values, and the largest error with them in tolerances."""
        from scipy.optimize import least_squares

        ends, values, cost = process_time() + SECONDS, self.start, np.inf
        while True:
            solution = least_squares(self.residuals, values, jac=self._jacobian, max_nfev=MAX_ITERATIONS)  # pyright: ignore[reportArgumentType]
            values, worst = solution.x, self._worst(solution.x)
            if worst <= GOAL or process_time() > ends or solution.cost > (1.0 - MIN_COST_REDUCTION) * cost:
                return values, worst
            cost = float(solution.cost)

    def residuals(self, values: Array) -> Array:
        """Return deviations of tracked points from the full scene's, in tolerances, flat."""
        return np.concatenate([self._deviation(evaluator, scene, values) for evaluator, scene in self.runs])

    def _deviation(self, evaluator: Evaluator, scene: ReducedScene, values: Array) -> Array:
        run = stepped(
            replace(scene, model=with_parameters(scene.model, self.parameters, values)), records=None
        )
        if run.broken:
            steps = int(np.ceil(scene.duration / float(scene.model.opt.timestep) - 1e-6))
            return np.full(3 * len(scene.places) * (steps + 1), DIVERGED_RESIDUAL)
        return (evaluator.deviation(run) / self.tolerance).ravel()

    def _worst(self, values: Array) -> float:
        return float(np.linalg.norm(self.residuals(values).reshape(-1, 3), axis=1).max())

    def _jacobian(self, values: Array) -> Array:
        current = self.residuals(values)
        steps = DIFFERENCE_STEP * np.eye(len(values))
        return np.stack([(self.residuals(values + step) - current) / DIFFERENCE_STEP for step in steps], 1)
