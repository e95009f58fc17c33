"""What a suite reports: cases with their differences, and the clone from which its files are read."""

import subprocess
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from typing import Any, Literal

from mechsim.errors import cut
from validation.published.table import Row

FIGURES = Path(__file__).parent / "figures"
# characters of a sentence
MAX_REASON = 120
PRINTED = "half a unit of the last printed digit"
Outcome = Literal["right", "source wrong", "mechsim wrong", "rejected", "unexplained"]


@dataclass(frozen=True, slots=True)
class Case:
    """A case that was tried.

    Attributes:
        name: as the source has it.
        rows: the compared quantities, with tolerances and their reasons.
        rejected: why mechsim does not take it; empty if it does.
        source_fault: why the source is wrong where a row exceeds its tolerance; it counts with evidence only.
        evidence: figures that show the stated reason, each within its tolerance; otherwise it does not count.
        own_fault: likewise, why mechsim is.
        note: what a difference within its tolerance comes from.
    """

    name: str
    rows: tuple[Row, ...] = ()
    rejected: str = ""
    source_fault: str = ""
    evidence: tuple[Row, ...] = ()
    own_fault: str = ""
    note: str = ""

    @property
    def outcome(self) -> Outcome:
        """The verdict: unexplained is a difference whose fault is not shown, and a case without rows."""
        shown = all(row.passed for row in self.evidence)
        if self.rejected:
            return "rejected" if shown else "unexplained"
        if self.rows and all(row.passed for row in self.rows):
            return "right"
        if self.source_fault and self.evidence and shown:
            return "source wrong"
        return "mechsim wrong" if self.own_fault else "unexplained"

    @property
    def remark(self) -> str:
        """The text that goes with the outcome."""
        return self.rejected or self.source_fault or self.own_fault or self.note

    @property
    def worst(self) -> Row | None:
        """The row nearest to its tolerance or farthest beyond it."""
        return max(self.rows, key=_nearness, default=None)

    @property
    def nearness(self) -> float:
        """The largest difference as a fraction of its tolerance."""
        return max(map(_nearness, self.rows), default=0.0)


def _nearness(row: Row) -> float:
    return row.error / (row.tolerance or 1e-300)


@dataclass(frozen=True, slots=True)
class Clone:
    """A git clone, bare or not; its newest commit is read."""

    folder: Path

    def read(self, path: str) -> str:
        """Return the text of a file."""
        return self._git("show", f"HEAD:{path}")

    def paths(self, folder: str) -> list[str]:
        """Return the paths of all files below a folder."""
        return self._git("ls-tree", "-r", "--name-only", "HEAD", folder).splitlines()

    @property
    def commit(self) -> str:
        """Its first characters and the date of the commit."""
        return self._git("log", "-1", "--date=format:%d %b %Y", "--format=%h of %cd").strip()

    def _git(self, *words: str) -> str:
        command = ["git", "-C", str(self.folder), *words]
        return subprocess.run(command, capture_output=True, text=True, check=True, errors="replace").stdout


@dataclass(frozen=True, slots=True)
class Suite:
    """Cases of one source.

    Attributes:
        title: what it is.
        repository: owner/name of the clone; empty if its figures are all here.
        about: what the references are, in a sentence or two.
        cases: clone, or None for the figures kept here -> cases.
    """

    title: str
    repository: str
    about: str
    cases: Callable[[Clone | None], Iterable[Case]]


def rejected(name: str, error: Exception, cause: Mapping[str, Any], evidence: tuple[Row, ...] = ()) -> Case:
    """Return the case that mechsim rejects: unexplained unless its message has the words of a cause."""
    text = " ".join(str(error).split())
    if "says" in cause and cause["says"] in text:
        return Case(name, rejected=cause["rejected"], evidence=evidence)
    return Case(name, note=cut(text, MAX_REASON))


def printed_rows(answers: str, value_of: Callable[[str], float]) -> Iterator[Row]:
    """Yield a row of each "QUANTITY=PRINTED", which are separated by semicolons."""
    for answer in filter(None, answers.split("; ")):
        quantity, printed = answer.split("=")
        last = 0.5 * 10.0 ** int(Decimal(printed).as_tuple().exponent)
        yield Row(answer, abs(value_of(quantity) - float(printed)), last, "", PRINTED)


def printed_case(name: str, entry: Mapping[str, str], value_of: Callable[[str], float]) -> Case:
    """Return the case of an entry with printed `values`.

    A `source_fault` is shown by the values of a third method, `exact`, which are ours, and by those that the
    fault causes, `caused`, which are the printed ones.
    """
    caused = dict(pair.split("=") for pair in entry.get("caused", "").split("; ") if pair)
    evidence = [*printed_rows(entry.get("exact", ""), value_of)]
    if caused:
        evidence += printed_rows(entry["values"], lambda quantity: float(caused[quantity]))
    fault = entry.get("source_fault", "") + (f"; exact: {entry['exact']}" if "exact" in entry else "")
    return Case(name, tuple(printed_rows(entry["values"], value_of)), "", fault, tuple(evidence))


def kept(name: str) -> Iterator[list[str]]:
    """Yield the rows of a table kept in figures/, without comments."""
    for line in (FIGURES / f"{name}.csv").read_text().splitlines():
        if line and not line.startswith("#"):
            yield line.split(",")
