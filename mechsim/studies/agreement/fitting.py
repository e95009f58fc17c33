"""The size of a hypothesis fitted to a miss: least squares, confirmed by solving again with that size."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from mechsim.errors import MechsimError
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.discrepancy import Hypothesis, Miss, rms

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
        left: root mean square of the errors that it leaves, in parts of their bounds.
        worst: largest of them.
        explains: the part of the miss that goes with it, 0 to 1.
        count: instants and components compared.
    """

    hypothesis: Hypothesis
    sizes: Array
    left: float
    worst: float
    explains: float
    count: int


def fitted(miss: Miss, hypothesis: Hypothesis) -> Fitted | None:
    """Return a hypothesis with the size that fits best; None where it can stand at no size."""
    before = rms(miss.errors(miss.exact, hypothesis.rows))
    if not before > 0.0:
        return None
    begun = [
        (np.array(start, dtype=float), _errors(miss, hypothesis, np.array(start, dtype=float)))
        for start in hypothesis.starts
    ]
    stand = [(start, found) for start, found in begun if found is not None]
    if not stand:
        return None
    left, sizes = _from(miss, hypothesis, *min(stand, key=lambda one: rms(one[1])), before)
    predicted = hypothesis.predict(sizes)
    count = len(miss.errors(predicted, hypothesis.rows))
    worst = miss.worst(predicted, hypothesis.rows)
    return Fitted(hypothesis, sizes, left, worst, miss.explained(left, before, worst), count)


def _errors(miss: Miss, hypothesis: Hypothesis, sizes: Array) -> Array | None:
    """Return what is left at sizes; None where nothing can stand so."""
    try:
        with np.errstate(all="ignore"):
            found = miss.errors(hypothesis.predict(sizes), hypothesis.rows)
    except (MechsimError, ValueError, ArithmeticError, np.linalg.LinAlgError):
        return None
    return found if np.isfinite(found).all() else None


def _from(
    miss: Miss, hypothesis: Hypothesis, sizes: Array, here: Array, before: float
) -> tuple[float, Array]:
    """Return what is left, and the sizes, from a start and what is left there."""
    if not len(sizes):
        return rms(here), sizes
    slope, fresh = _slope(miss, hypothesis, sizes, here), True
    for number in range(STEPS):
        if number == SOON and rms(here) > HOPE * before:
            break
        if slope is None or rms(here) <= max(NOTHING, OF_MISS * before):
            break
        step: Array = -np.linalg.lstsq(slope, here, rcond=1e-10)[0].astype(np.float64)
        taken = _shortened(miss, hypothesis, sizes, here, step)
        if taken is None:
            if fresh:
                break
            slope, fresh = _slope(miss, hypothesis, sizes, here), True
            continue
        moved, there = taken
        gone, change = moved - sizes, there - here
        ratio = rms(there) / rms(here)
        sizes, here = moved, there
        if ratio > STALE and not fresh:
            slope, fresh = _slope(miss, hypothesis, sizes, here), True
        elif ratio > 1.0 - WORTH:
            break
        else:
            # the slope that this step really had
            slope = slope + np.outer(change - slope @ gone, gone) / max(float(gone @ gone), 1e-300)
            fresh = False
    return rms(here), sizes


def _shortened(
    miss: Miss, hypothesis: Hypothesis, sizes: Array, here: Array, step: Array
) -> tuple[Array, Array] | None:
    """Return sizes a step on that leave less, and what they leave; None where none do."""
    for halving in range(HALVINGS):
        moved = sizes + step * 0.5**halving
        there = _errors(miss, hypothesis, moved)
        if there is not None and rms(there) < rms(here):
            return moved, there
        if there is not None and rms(step) < 1e-12:
            return None
    return None


def _slope(miss: Miss, hypothesis: Hypothesis, sizes: Array, here: Array) -> Array | None:
    """Return the derivatives of what is left by the sizes, (m, p)."""
    if hypothesis.slope is not None and not sizes.any() and len(sizes) == 1:
        # of efforts, and where loops would be torn, there are differences only
        with suppress(MechsimError, KeyError):
            at = hypothesis.slope()
            parts = [-(values / bound).ravel() for values, bound in zip(at, miss.bounds, strict=True)]
            return np.concatenate(parts)[:, None]
    columns: list[Array] = []
    for i, step in enumerate(hypothesis.steps):
        beside = sizes.copy()
        beside[i] += step
        there = _errors(miss, hypothesis, beside)
        if there is None:
            beside[i] -= 2.0 * step
            there, step = _errors(miss, hypothesis, beside), -step
        if there is None:
            return None
        columns.append((there - here) / step)
    return np.stack(columns, 1)


def linearly_explains(miss: Miss, slope: Array) -> float:
    """Return the part of a miss that goes with slopes (m, p), in the first order.

    Beside noise a cause counts in full whose fit is better than chance: by more than `ODDS` in chi squared.
    """
    solution = np.linalg.lstsq(slope, miss.before, rcond=1e-10)[0]
    left = rms(miss.before - slope @ solution)
    gain = len(miss.before) * (miss.size**2 - left**2)
    return 1.0 - left / miss.size + (1.0 if miss.noisy and gain > ODDS else 0.0)
