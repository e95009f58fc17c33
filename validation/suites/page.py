"""The page docs/explanation/outside_evidence.md, written from results."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any

from validation.published.table import Row
from validation.suites.case import Case, Clone, Suite

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "outside_evidence.md"
HEAD = """# Evidence from others

`python -m validation.suites [SUITE] --source FOLDER` solves cases with published answers and writes the
sections of this page; FOLDER holds git clones. The tables list cases that are not right, and the right one
nearest to its tolerance. A fault counts only if figures of a third method, in `--json`, confirm it.

Last written on {day} with mechsim {mechsim}, numpy {numpy}.

| suite | tried | right | source wrong | mechsim wrong | rejected | unexplained |
|---|---|---|---|---|---|---|
"""
# cases of a suite of which every one with a remark has a row
FEW = 11
COUNTED = ("right", "source wrong", "mechsim wrong", "rejected", "unexplained")


def figures(rows: Sequence[Row]) -> list[dict[str, Any]]:
    return [{"difference" if k == "error" else k: v for k, v in asdict(row).items()} for row in rows]


def record(case: Case) -> dict[str, Any]:
    """Return a case as JSON has it."""
    texts = {name: getattr(case, name) for name in ("rejected", "source_fault", "own_fault", "note")}
    texts |= {"evidence": figures(case.evidence)}
    head = {"case": case.name, "outcome": case.outcome, "rows": figures(case.rows)}
    return head | {name: text for name, text in texts.items() if text}


def counts(suite: Suite, cases: Sequence[Case]) -> str:
    tally = Counter(case.outcome for case in cases)
    return f"| {suite.title} | {len(cases)} | " + " | ".join(str(tally[what]) for what in COUNTED) + " |\n"


def section(suite: Suite, clone: Clone | None, cases: Sequence[Case]) -> str:
    source = f"`{suite.repository}` at {clone.commit}. " if clone else ""
    nearest = max(cases, key=lambda case: (case.outcome == "right", case.nearness), default=None)
    lines, reasons = [f"\n## {suite.title}\n\n{source}{suite.about}\n\n"], set[str]()
    lines.append("| case | worst | difference | tolerance | remark |\n|---|---|---|---|---|\n")
    for case in cases:
        if (row := case.worst) and (
            case is nearest or case.outcome != "right" or (case.note and len(cases) <= FEW)
        ):
            worst = f"{row.quantity} | {row.error:.1e} {row.unit} | {row.tolerance:.0e}"
            lines.append(f"| {case.name} | {worst} | {case.remark} |\n")
            reasons.add(row.reason)
    texts = {c.name: "unexplained: " * (c.outcome == "unexplained") + c.remark for c in cases if not c.rows}
    lines += ["\n| rejected | reason |\n|---|---|\n"] * bool(texts)
    for text in dict.fromkeys(texts.values()):
        lines.append(f"| {', '.join(name for name in texts if texts[name] == text)} | {text} |\n")
    return "".join(lines) + "\nTolerances: " + "; ".join(sorted(reasons)) + ".\n"


def kept(suite: Suite, page: str) -> tuple[str, str]:
    """Return the count and the section of a suite that was not run now."""
    head, _, rest = page.partition(f"\n## {suite.title}\n")
    count = next((line for line in head.splitlines(True) if line.startswith(f"| {suite.title} |")), "")
    return count, f"\n## {suite.title}\n{rest.partition(chr(10) + '## ')[0].rstrip()}\n" if rest else ""


def write(
    suites: Mapping[str, Suite], clones: Mapping[str, Clone | None], results: Mapping[str, Sequence[Case]]
) -> None:
    """Write the page; sections of suites without results stay."""
    day, old = date.today().strftime("%d %B %Y"), PAGE.read_text()
    tables = [
        (counts(suite, results[name]), section(suite, clones[name], results[name]))
        if name in results
        else kept(suite, old)
        for name, suite in suites.items()
    ]
    text = HEAD.format(day=day, mechsim=version("mechsim"), numpy=version("numpy"))
    PAGE.write_text(text + "".join(count for count, _ in tables) + "".join(text for _, text in tables))
