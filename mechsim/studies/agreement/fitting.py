"""The size of a hypothesis fitted to a difference: least squares with solved values."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mechsim.errors import MechsimError
from mechsim.numerics.arrays import Array, rms
from mechsim.studies.agreement.evaluation_points import Hypothesis
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


def fitted(misfit: Misfit, hypothesis: Hypothesis) -> Fitted | None:
    """Return a hypothesis with the best-fitting sizes; None if it cannot be assembled at any start."""
    before = rms(misfit.errors(misfit.exact, hypothesis.rows))
    if not before > 0.0:
        return None
    starts = [
        (np.array(start, dtype=float), _errors(misfit, hypothesis, np.array(start, dtype=float)))
        for start in hypothesis.starts
    ]
    assembled = [(start, errors) for start, errors in starts if errors is not None]
    if not assembled:
        return None
    remaining, sizes = _minimised(misfit, hypothesis, *min(assembled, key=lambda pair: rms(pair[1])), before)
    predicted = hypothesis.predict(sizes)
    count = len(misfit.errors(predicted, hypothesis.rows))
    worst = misfit.worst(predicted, hypothesis.rows)
    return Fitted(hypothesis, sizes, remaining, worst, misfit.explained(remaining, before, worst), count)


def _errors(misfit: Misfit, hypothesis: Hypothesis, sizes: Array) -> Array | None:
    """Return the remaining errors at sizes; None if the mechanism cannot be assembled there."""
    try:
        with np.errstate(all="ignore"):
            errors = misfit.errors(hypothesis.predict(sizes), hypothesis.rows)
    except (MechsimError, ValueError, ArithmeticError, np.linalg.LinAlgError):
        return None
    return errors if np.isfinite(errors).all() else None


def _minimised(
    misfit: Misfit, hypothesis: Hypothesis, sizes: Array, current: Array, before: float
) -> tuple[float, Array]:
    """Return the remaining error and the fitted sizes, starting from sizes and their errors."""
    if not len(sizes):
        return rms(current), sizes
    jacobian, is_exact = _jacobian(misfit, hypothesis, sizes, current), True
    for number in range(MAX_STEPS):
        if number == TRIAL_STEPS and rms(current) > MAX_TRIAL_REMAINING * before:
            break
        if jacobian is None or rms(current) <= max(ZERO_ERROR, RELATIVE_ROUNDING * before):
            break
        step: Array = -np.linalg.lstsq(jacobian, current, rcond=1e-10)[0].astype(np.float64)
        step_taken = _shortened(misfit, hypothesis, sizes, current, step)
        if step_taken is None:
            if is_exact:
                break
            jacobian, is_exact = _jacobian(misfit, hypothesis, sizes, current), True
            continue
        moved, next_errors = step_taken
        displacement, change = moved - sizes, next_errors - current
        ratio = rms(next_errors) / rms(current)
        sizes, current = moved, next_errors
        if ratio > STALE_JACOBIAN and not is_exact:
            jacobian, is_exact = _jacobian(misfit, hypothesis, sizes, current), True
        elif ratio > 1.0 - MIN_DECREASE:
            break
        else:
            # Broyden's update: the derivative along the step just taken
            jacobian = jacobian + np.outer(change - jacobian @ displacement, displacement) / max(
                float(displacement @ displacement), 1e-300
            )
            is_exact = False
    return rms(current), sizes


def _shortened(
    misfit: Misfit, hypothesis: Hypothesis, sizes: Array, current: Array, step: Array
) -> tuple[Array, Array] | None:
    """Return shortened-step sizes with smaller errors, and those errors; None if there are none."""
    for halving in range(MAX_HALVINGS):
        moved = sizes + step * 0.5**halving
        next_errors = _errors(misfit, hypothesis, moved)
        if next_errors is not None and rms(next_errors) < rms(current):
            return moved, next_errors
        if next_errors is not None and rms(step) < 1e-12:
            return None
    return None


def _jacobian(misfit: Misfit, hypothesis: Hypothesis, sizes: Array, current: Array) -> Array | None:
    """Return the derivatives of the errors by the sizes, (m, p)."""
    if hypothesis.derivative is not None and not sizes.any() and len(sizes) == 1:
        # forces, and dimensions that open the loops, have no exact derivatives
        with suppress(MechsimError, KeyError):
            derivatives = hypothesis.derivative()
            rows = [
                -(values / tolerance).ravel()
                for values, tolerance in zip(derivatives, misfit.bounds, strict=True)
            ]
            return np.concatenate(rows)[:, None]
    columns: list[Array] = []
    for i, step in enumerate(hypothesis.steps):
        perturbed = sizes.copy()
        perturbed[i] += step
        next_errors = _errors(misfit, hypothesis, perturbed)
        if next_errors is None:
            perturbed[i] -= 2.0 * step
            next_errors, step = _errors(misfit, hypothesis, perturbed), -step
        if next_errors is None:
            return None
        columns.append((next_errors - current) / step)
    return np.stack(columns, 1)


def linearly_explains(misfit: Misfit, jacobian: Array) -> float:
    """Return the fraction of a misfit that derivatives (m, p) explain to first order.

    With noise, a cause counts in full if its fit is better than chance: by more than `ODDS` in chi squared.
    """
    solution = np.linalg.lstsq(jacobian, misfit.before, rcond=1e-10)[0]
    remaining = rms(misfit.before - jacobian @ solution)
    gain = len(misfit.before) * (misfit.magnitude**2 - remaining**2)
    return 1.0 - remaining / misfit.magnitude + (1.0 if misfit.noisy and gain > ODDS else 0.0)
