"""The size of a hypothesis fitted to a difference: least squares with solved values."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mechsim.errors import MechsimError
from mechsim.numerics.arrays import Array, rms
from mechsim.studies.agreement.evaluation_points import Hypothesis, Values
from mechsim.studies.agreement.misfit import Misfit

# twice the log-likelihood ratio above which a worse-fitting cause is dropped
ODDS = 12.0
# largest number of steps, and of halvings of one step
MAX_STEPS, MAX_HALVINGS = 14, 8
# relative decrease of the errors that justifies another step; errors that count as zero, relative to the
# tolerances and to the difference
MIN_DECREASE, ZERO_ERROR, RELATIVE_ROUNDING = 1e-3, 1e-4, 1e-9
# a hypothesis that leaves more than this fraction of the difference after so many steps is given up
TRIAL_STEPS, MAX_TRIAL_REMAINING = 4, 0.7
# ratio of errors after and before a step above which the Jacobian is recomputed
STALE_JACOBIAN = 0.7


@dataclass(frozen=True)
class Fitted:
    """A hypothesis with its fitted sizes.

    Attributes:
        hypothesis: the hypothesis.
        sizes: fitted, (p,).
        remaining: root mean square of the remaining errors, relative to their tolerances.
        worst: largest of them.
        explains: explained fraction of the difference, 0 to 1.
        count: number of instants and components compared.
    """

    hypothesis: Hypothesis
    sizes: Array
    remaining: float
    worst: float
    explains: float
    count: int


@dataclass(frozen=True, slots=True)
class _FitTrial:
    """Predicted values of a hypothesis for some sizes, and the remaining errors."""

    sizes: Array
    predicted: Values
    errors: Array

    @property
    def remaining(self) -> float:
        return rms(self.errors)


def fitted(misfit: Misfit, hypothesis: Hypothesis) -> Fitted | None:
    """Return a hypothesis with the best-fitting sizes; None if it cannot be assembled at any start."""
    before = rms(misfit.errors(misfit.exact, hypothesis.rows))
    if not before > 0.0:
        return None
    starts = [_trial(misfit, hypothesis, np.array(start, dtype=float)) for start in hypothesis.starts]
    nearest = min(filter(None, starts), key=lambda trial: trial.remaining, default=None)
    if nearest is None:
        return None
    best = _minimised(misfit, hypothesis, nearest, before) if len(nearest.sizes) else nearest
    worst = misfit.worst(best.predicted, hypothesis.rows)
    explains = max(0.0, 1.0 - best.remaining / before)
    return Fitted(hypothesis, best.sizes, best.remaining, worst, explains, len(best.errors))


def _trial(misfit: Misfit, hypothesis: Hypothesis, sizes: Array) -> _FitTrial | None:
    """Return the trial of some sizes; None if the mechanism cannot be assembled there."""
    try:
        with np.errstate(all="ignore"):
            predicted = hypothesis.predict(sizes)
            errors = misfit.errors(predicted, hypothesis.rows)
    except (MechsimError, ValueError, ArithmeticError, np.linalg.LinAlgError):
        return None
    return _FitTrial(sizes, predicted, errors) if np.isfinite(errors).all() else None


def _minimised(misfit: Misfit, hypothesis: Hypothesis, current: _FitTrial, before: float) -> _FitTrial:
    """Return the trial with the smallest errors, from a trial to start with."""
    jacobian, is_exact = _jacobian(misfit, hypothesis, current), True
    for number in range(MAX_STEPS):
        if number == TRIAL_STEPS and current.remaining > MAX_TRIAL_REMAINING * before:
            break
        if jacobian is None or current.remaining <= max(ZERO_ERROR, RELATIVE_ROUNDING * before):
            break
        step: Array = -np.linalg.lstsq(jacobian, current.errors, rcond=1e-10)[0].astype(np.float64)
        moved = _shortened(misfit, hypothesis, current, step)
        if moved is None:
            if is_exact:
                break
            jacobian, is_exact = _jacobian(misfit, hypothesis, current), True
            continue
        displacement, change = moved.sizes - current.sizes, moved.errors - current.errors
        ratio = moved.remaining / current.remaining
        current = moved
        if ratio > STALE_JACOBIAN and not is_exact:
            jacobian, is_exact = _jacobian(misfit, hypothesis, current), True
        elif ratio > 1.0 - MIN_DECREASE:
            break
        else:
            # Broyden's update: the derivative along the step just taken
            square = max(float(displacement @ displacement), 1e-300)
            jacobian = jacobian + np.outer(change - jacobian @ displacement, displacement) / square
            is_exact = False
    return current


def _shortened(misfit: Misfit, hypothesis: Hypothesis, current: _FitTrial, step: Array) -> _FitTrial | None:
    """Return the trial of a shortened step with smaller errors; None if there is none."""
    for halving in range(MAX_HALVINGS):
        moved = _trial(misfit, hypothesis, current.sizes + step * 0.5**halving)
        if moved is not None and moved.remaining < current.remaining:
            return moved
        if moved is not None and rms(step) < 1e-12:
            return None
    return None


def _jacobian(misfit: Misfit, hypothesis: Hypothesis, current: _FitTrial) -> Array | None:
    """Return the derivatives of the errors by the sizes, (m, p)."""
    if hypothesis.derivative is not None and not current.sizes.any():
        # forces, and dimensions that open the loops, have no exact derivatives
        with suppress(MechsimError, KeyError):
            return -misfit.scaled(hypothesis.derivative())[:, None]
    columns: list[Array] = []
    for step, direction in zip(hypothesis.steps, np.eye(len(hypothesis.steps)), strict=True):
        ahead = _trial(misfit, hypothesis, current.sizes + step * direction)
        if ahead is None:
            step = -step
            ahead = _trial(misfit, hypothesis, current.sizes + step * direction)
        if ahead is None:
            return None
        columns.append((ahead.errors - current.errors) / step)
    return np.stack(columns, 1)


def linearly_explains(misfit: Misfit, jacobian: Array) -> float:
    """Return the fraction of a misfit that derivatives (m, p) explain to first order."""
    solution = np.linalg.lstsq(jacobian, misfit.before, rcond=1e-10)[0]
    return 1.0 - rms(misfit.before - jacobian @ solution) / misfit.magnitude
