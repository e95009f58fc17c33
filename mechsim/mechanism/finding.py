"""Findings: faults of a model before it runs, and causes of a difference."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import ClassVar, Literal, TypedDict, get_args


class FilePosition(TypedDict):
    """Position in a model file: an included file (empty for the main file) and the line, if known."""

    file: str
    line: int | None


# remedy of a finding that needs no repair
HARMLESS = "harmless"
Severity = Literal["error", "warning", "note"]
NO_POSITION: FilePosition = {"file": "", "line": None}


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """A fault or a cause of a difference, with its magnitude.

    Attributes:
        kind: its kind, one word.
        object: the component, parameter or quantity it concerns.
        value: its magnitude, in the unit that `message` states; of a step or a time constant its ratio to the
            longest stable or the shortest kept one.
        target: value with which it is gone; None where no single value is right.
        rule: code of the rule of `mechsim check`; of others their kind.
        explains: fraction of a difference that it explains, 0 to 1; 0 without a comparison.
        message: one sentence for people.
        remedy: how to repair it; empty if nothing needs repair.
        line: its line in the file; None if it has no single line.
        file: the included file that contains the line; empty for the main file, whose path `check` states.
        certain: whether its repair removes the difference.
        severity: "error" if a run becomes wrong, "warning" if it is distorted, "note" for information.
    """

    JSON: ClassVar[tuple[str, ...]] = (
        *("rule", "kind", "object", "value", "target", "gap", "message", "remedy", "explains", "certain"),
        *("severity", "file", "line"),
    )

    kind: str
    object: str
    value: float
    message: str
    target: float | None = 0.0
    rule: str = ""
    explains: float = 0.0
    remedy: str = ""
    line: int | None = None
    file: str = ""
    certain: bool = False
    severity: Severity = "note"

    def __post_init__(self) -> None:
        object.__setattr__(self, "rule", self.rule or self.kind)

    @property
    def gap(self) -> float | None:
        """What is missing: value minus target."""
        return None if self.target is None else self.value - self.target

    @property
    def advice(self) -> str:
        """The message and its remedy."""
        return self.message + (f"; {self.remedy}" if self.remedy else "")

    @property
    def one_line(self) -> str:
        """Position, message and remedy in one line."""
        return f"{self.position}: {self.advice}" if self.position else self.advice

    @property
    def position(self) -> str:
        """File and line in words; empty if unknown."""
        line = "" if self.line is None else f"line {self.line}"
        return ", ".join(filter(None, [self.file, line]))


def by_severity(*findings: Finding) -> tuple[Finding, ...]:
    """Return findings, errors first, then warnings."""
    return tuple(sorted(findings, key=lambda finding: ("error", "warning", "note").index(finding.severity)))


def counted_findings(count: int) -> str:
    """Return ", n findings" for a passed verdict; empty for none."""
    return f", {count} finding{'s' * (count != 1)}" if count else ""


# outcomes of a comparison, or of a run with a tolerance, from the best to the worst; the last two are of a
# model with fewer or more independent drivers than degrees of freedom
Compared = Literal[
    "passed",
    "failed",
    "changed assembly",
    "diverged",
    "cannot assemble",
    "underdetermined",
    "overdetermined",
]
SEVERITY: tuple[Compared, ...] = get_args(Compared)
Outcome = Literal[
    Compared,
    # of a run without a tolerance; "done" reached its end
    "done",
    "time over",
    "cannot start",
    "turned back",
    "stopped",
    "dead centre",
    # friction by the load without a solution, or with several
    "jammed",
    "undetermined",
    "too stiff",
    "work budget spent",
]

# default tolerance of positions, relative to the stroke: a twentieth of the effect of a link 0.1 % too long
POSITION_TOLERANCE = 1e-4


def most_severe(outcomes: Iterable[Outcome]) -> int:
    """Return the index of the worst of several outcomes, the first if several are equal."""
    severity: tuple[Outcome, ...] = SEVERITY
    ranks = [severity.index(outcome) for outcome in outcomes]
    return ranks.index(max(ranks))
