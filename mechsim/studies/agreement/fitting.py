"""The size of a hypothesis fitted to a miss: least squares, confirmed by solving again with that size."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mechsim.errors import MechsimError
from mechsim.numerics.arrays import Array, rms
from mechsim.studies.agreement.evaluation_points import Hypothesis
from mechsim.studies.agreement.misfit import Misfit

# twice the logarithm of the odds by which another cause must explain less to be left out
ODDS = 12.0
# steps at the most, and halvings of one
STEPS, HALVINGS = 14, 8
# a change of what is left that is worth another step; what is nothing, in parts of bounds and of the miss
WORTH, NOTHING, OF_MISS = 1e-3, 1e-4, 1e-9
# what leaves more than this part of the miss after so many steps is no cause of it
SOON, HOPE = 4, 0.7
# a slope that does not halve what is left in so many steps is taken anew
STALE = 0.7


@dataclass(frozen=True)
class Fitted:
    """A hypothesis with its size.

    Attributes:
        hypothesis: whose.
        sizes: fitted, (p,).
        remaining: root mean square of the errors that it leaves, in parts of their bounds.
        worst: largest of them.
        explains: the part of the miss that goes with it, 0 to 1.
        count: instants and components compared.
    """

    hypothesis: Hypothesis
    sizes: Array
    remaining: float
    worst: float
    explains: float
    count: int


def fitted(misfit: Misfit, hypothesis: Hypothesis) -> Fitted | None:
    """Return a hypothesis with the size that fits best; None where it closes at no size."""
    before = rms(misfit.errors(misfit.exact, hypothesis.rows))
    if not before > 0.0:
        return None
    starts = [
        (np.array(start, dtype=float), _errors(misfit, hypothesis, np.array(start, dtype=float)))
        for start in hypothesis.starts
    ]
    stand = [(start, errors) for start, errors in starts if errors is not None]
    if not stand:
        return None
    remaining, sizes = _from(misfit, hypothesis, *min(stand, key=lambda pair: rms(pair[1])), before)
    predicted = hypothesis.predict(sizes)
    count = len(misfit.errors(predicted, hypothesis.rows))
    worst = misfit.worst(predicted, hypothesis.rows)
    return Fitted(hypothesis, sizes, remaining, worst, misfit.explained(remaining, before, worst), count)


def _errors(misfit: Misfit, hypothesis: Hypothesis, sizes: Array) -> Array | None:
    """Return what is left at sizes; None where nothing can stand so."""
    try:
        with np.errstate(all="ignore"):
            errors = misfit.errors(hypothesis.predict(sizes), hypothesis.rows)
    except (MechsimError, ValueError, ArithmeticError, np.linalg.LinAlgError):
        return None
    return errors if np.isfinite(errors).all() else None


def _from(
    misfit: Misfit, hypothesis: Hypothesis, sizes: Array, current: Array, before: float
) -> tuple[float, Array]:
    """Return what is left, and the sizes, from a start and what is left there."""
    if not len(sizes):
        return rms(current), sizes
    jacobian, fresh = _jacobian(misfit, hypothesis, sizes, current), True
    for number in range(STEPS):
        if number == SOON and rms(current) > HOPE * before:
            break
        if jacobian is None or rms(current) <= max(NOTHING, OF_MISS * before):
            break
        step: Array = -np.linalg.lstsq(jacobian, current, rcond=1e-10)[0].astype(np.float64)
        step_taken = _shortened(misfit, hypothesis, sizes, current, step)
        if step_taken is None:
            if fresh:
                break
            jacobian, fresh = _jacobian(misfit, hypothesis, sizes, current), True
            continue
        moved, next_errors = step_taken
        displacement, change = moved - sizes, next_errors - current
        ratio = rms(next_errors) / rms(current)
        sizes, current = moved, next_errors
        if ratio > STALE and not fresh:
            jacobian, fresh = _jacobian(misfit, hypothesis, sizes, current), True
        elif ratio > 1.0 - WORTH:
            break
        else:
            # the slope that this step really had
            jacobian = jacobian + np.outer(change - jacobian @ displacement, displacement) / max(
                float(displacement @ displacement), 1e-300
            )
            fresh = False
    return rms(current), sizes


def _shortened(
    misfit: Misfit, hypothesis: Hypothesis, sizes: Array, current: Array, step: Array
) -> tuple[Array, Array] | None:
    """Return sizes a step on that leave less, and what they leave; None where none do."""
    for halving in range(HALVINGS):
        moved = sizes + step * 0.5**halving
        next_errors = _errors(misfit, hypothesis, moved)
        if next_errors is not None and rms(next_errors) < rms(current):
            return moved, next_errors
        if next_errors is not None and rms(step) < 1e-12:
            return None
    return None


def _jacobian(misfit: Misfit, hypothesis: Hypothesis, sizes: Array, current: Array) -> Array | None:
    """Return the derivatives of what is left by the sizes, (m, p)."""
    if hypothesis.derivative is not None and not sizes.any() and len(sizes) == 1:
        # of efforts, and where loops would be torn, there are differences only
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
