"""A hypothesis: what would be claimed if one thing were wrong, with the size of it to be fitted."""

from collections.abc import Callable
from dataclasses import dataclass

from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.miss import Rows, Values

# of causes that explain equally well the one that needs least is said: first those without a size, then those
# with one, last those with several
DISCRETE, NAMED, PLACED, TWO, THREE, SIX = 0.0, 1.0, 1.5, 2.0, 3.0, 6.0


@dataclass(frozen=True)
class Hypothesis:
    """One thing that may be wrong.

    Attributes:
        kind: in a word, as `Finding` has it.
        what: the parameter, joint, point or driver.
        tier: how much it asks one to believe; see above.
        predict: sizes (p,) -> what would be claimed.
        say: sizes (p,) -> the sentence, without how much it explains.
        by: sizes (p,) -> its size as one number.
        starts: sizes from which the fit begins; none where there is nothing to fit.
        steps: of differences by the sizes.
        slope: derivatives of the predicted values by the one size where it is nothing; None where
            differences are taken.
        rows: instants that count; None for all.
    """

    kind: str
    what: str
    tier: float
    predict: Callable[[Array], Values]
    say: Callable[[Array], str]
    by: Callable[[Array], float] = lambda p: float(p[0]) if len(p) else 0.0
    starts: tuple[tuple[float, ...], ...] = ((),)
    steps: tuple[float, ...] = ()
    slope: Callable[[], Values] | None = None
    rows: Rows | None = None
