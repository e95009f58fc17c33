"""What was found: of a scene before it runs, or of a difference that is to be explained."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal, TypedDict


class FilePosition(TypedDict):
    """Where something stands: in an included file, empty for the file itself, and on which line, if known."""

    file: str
    line: int | None


NO_POSITION: FilePosition = {"file": "", "line": None}


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that was found, with its size.

    Attributes:
        kind: one word for it.
        what: the part, parameter or quantity it is of.
        by: its size, in the unit that `message` names.
        explains: part of a difference that it explains, 0 to 1; 0 where nothing was compared.
        message: one sentence for people.
        remedy: how to repair it; empty where nothing needs repair.
        line: of the file it is in; None where it is in none, or in no single line.
        file: the included file that holds the line; empty for the file itself.
        certain: whether a difference that was compared vanishes when this is repaired.
    """

    kind: str
    what: str
    by: float
    message: str
    explains: float = 0.0
    remedy: str = ""
    line: int | None = None
    file: str = ""
    certain: bool = False

    def as_dict(self) -> dict[str, Any]:
        """Return the finding as JSON has it."""
        return asdict(self)

    @property
    def advice(self) -> str:
        """The finding and its remedy."""
        return self.message + (f"; {self.remedy}" if self.remedy else "")

    @property
    def one_line(self) -> str:
        """The finding in one line: where, what, remedy."""
        return f"{self.position}: {self.advice}" if self.position else self.advice

    @property
    def position(self) -> str:
        """File and line in words; empty where they are not known."""
        line = "" if self.line is None else f"line {self.line}"
        return ", ".join(filter(None, [self.file, line]))


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
