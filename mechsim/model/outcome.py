"""How a run or a comparison ended: one word from one list."""

from collections.abc import Iterable
from typing import Literal

Outcome = Literal[
    # of a comparison, or of a run that was given a tolerance
    "passed",
    "failed",
    "changed assembly",
    "diverged",
    "cannot assemble",
    # of a model whose drivers leave freedoms open, or are more than there are freedoms
    "underdetermined",
    "overdetermined",
    # of a run without one: "done" is what was asked for
    "done",
    "time over",
    "cannot start",
    "turned back",
    "stopped",
    "dead centre",
]

# bound on places where none is asked for, in units of the stroke: a twentieth of what a link 0.1 % long does
POSITION_TOLERANCE = 1e-4

# from good to bad
SEVERITY: tuple[Outcome, ...] = (
    "passed",
    "failed",
    "changed assembly",
    "diverged",
    "cannot assemble",
    "underdetermined",
    "overdetermined",
)


def most_severe(outcomes: Iterable[Outcome]) -> int:
    """Return which of some outcomes of comparisons is the worst, the first of equals."""
    ranks = [SEVERITY.index(outcome) for outcome in outcomes]
    return ranks.index(max(ranks))
