"""How a run or a comparison ended: one word from one list."""

from collections.abc import Iterable
from typing import Literal

Outcome = Literal[
    # of a comparison, or of a run that was given a tolerance
    "met",
    "missed",
    "changed assembly",
    "diverged",
    "cannot assemble",
    # of a model whose drivers leave freedoms open, or are more than there are freedoms
    "undetermined",
    "overdriven",
    # of a run without one: "done" is what was asked for
    "done",
    "time over",
    "cannot start",
    "turned back",
    "stopped",
    "dead centre",
]

# bound on places where none is asked for, in units of the stroke: a twentieth of what a link 0.1 % long does
PLACE = 1e-4

# from good to bad
GRAVITY: tuple[Outcome, ...] = (
    "met",
    "missed",
    "changed assembly",
    "diverged",
    "cannot assemble",
    "undetermined",
    "overdriven",
)


def gravest(outcomes: Iterable[Outcome]) -> int:
    """Return which of some outcomes of comparisons is the worst, the first of equals."""
    ranks = [GRAVITY.index(outcome) for outcome in outcomes]
    return ranks.index(max(ranks))
