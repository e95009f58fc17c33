"""A hypothesis about a difference: one thing that may be wrong, and the values that it predicts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array

Values = Sequence[Array]
Rows = NDArray[np.bool_]

# tiers: of causes that explain equally well the one that assumes least is reported: first those without a
# size, then those with one, last those with several
DISCRETE, NAMED, PLACED, TWO, THREE, SIX = 0.0, 1.0, 1.5, 2.0, 3.0, 6.0


@dataclass(frozen=True)
class Hypothesis:
    """One thing that may be wrong.

    Attributes:
        kind: in a word, as `Finding` has it.
        what: the parameter, joint, point or driver.
        tier: how much it assumes; see above.
        predict: sizes (p,) -> the values that a candidate would have.
        text: sizes (p,) -> the sentence, without how much it explains.
        by: sizes (p,) -> its size as one number.
        starts: sizes from which the fit begins; none where there is nothing to fit.
        steps: of differences by the sizes.
        derivative: of the predicted values by the one size at zero; None where differences are taken.
        rows: instants that count; None for all.
    """

    kind: str
    what: str
    tier: float
    predict: Callable[[Array], Values]
    text: Callable[[Array], str]
    by: Callable[[Array], float] = lambda p: float(p[0])
    starts: tuple[tuple[float, ...], ...] = ((),)
    steps: tuple[float, ...] = ()
    derivative: Callable[[], Values] | None = None
    rows: Rows | None = None


def discrete(
    kind: str,
    what: str,
    predict: Callable[[], Values],
    text: str,
    by: float = 0.0,
    *,
    tier: float = DISCRETE,
    rows: Rows | None = None,
) -> Hypothesis:
    """Return a hypothesis without a size to fit; arguments as of `Hypothesis`."""
    return Hypothesis(kind, what, tier, lambda _: predict(), lambda _: text, lambda _: by, rows=rows)


def sized(
    kind: str,
    what: str,
    predict: Callable[[float], Values],
    text: Callable[[float], str],
    step: float,
    *,
    starts: Sequence[float] = (0.0,),
    tier: float = NAMED,
    by: Callable[[float], float] = float,
    derivative: Callable[[], Values] | None = None,
) -> Hypothesis:
    """Return a hypothesis with one size; arguments as of `Hypothesis`."""
    return Hypothesis(
        kind,
        what,
        tier,
        lambda p: predict(float(p[0])),
        lambda p: text(float(p[0])),
        lambda p: by(float(p[0])),
        starts=tuple((start,) for start in starts),
        steps=(step,),
        derivative=derivative,
    )
