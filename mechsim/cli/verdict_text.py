"""Verdicts for people: a line a method, the failed checks and their cause, or a table of all checks."""

import math
import re
from collections.abc import Mapping, Sequence

import typer

from mechsim.cli.output import print_table
from mechsim.cli.terminal import labelled, pass_or_fail, width
from mechsim.model.finding import Finding
from mechsim.pictures.number_text import prefixed
from mechsim.verdict.checks import Check, Verdict, check_table

# what each method of a verdict compares
METHODS = {
    "closed form": "analytic formula vs loop equations",
    "formula": "known solution vs loop equations",
    "pose": "MuJoCo, solved poses",
    "step": "MuJoCo, stepped",
    "as published": "MuJoCo, the file's own settings",
}
# failed checks that are listed without -v
MOST_FAILED = 3
# units whose first letter is no prefix, and which take none
WITHOUT_PREFIX = ("kg", "1")
# columns kept for the time that a validation took
DURATION_WIDTH = 6
# as in "rod is 0.199 m instead of 0.2 m (-0.5 %)"
RELATIVE_CHANGE = re.compile(r" \([-+]\S+ %\)")


def print_verdict(title: str, verdict: Verdict, *, reasons: bool = True) -> None:
    """Print a verdict and a table of all its checks, with the reason for each tolerance."""
    head, rows = check_table(verdict.checks)
    columns = slice(None if reasons else -1)
    heading = f"{title}: {verdict.outcome}" + (f" - {verdict.reason}" if verdict.reason else "")
    print_table(heading, head[columns], [row[columns] for row in rows])


def print_verdicts(verdicts: Mapping[str, Verdict], *, verbose: bool) -> None:
    """Print a line for each verdict, failures with what is off first; all checks if verbose."""
    for name, verdict in verdicts.items():
        if verbose:
            print_verdict(name, verdict)
        elif not verdict.passed:
            typer.echo(headline(name, verdict.passed))
            for line in failure_lines(verdict.checks, (), verdict.reason):
                typer.echo(line)
    for line in summary_lines(verdicts):
        typer.echo(line)


def summary_lines(verdicts: Mapping[str, Verdict]) -> list[str]:
    """Return a line for each verdict: how many checks, PASS or FAIL, the largest error."""
    longest = max(map(len, verdicts), default=0)
    return [
        f"  {name:<{longest}}  {len(verdict.checks):>4} checks   {pass_or_fail(verdict.passed)}  "
        f"{percentage(verdict.checks):>7}"
        for name, verdict in verdicts.items()
    ]


def headline(left: str, passed: bool, seconds: float | None = None) -> str:
    """Return a title with PASS or FAIL, and the time taken, at the right edge."""
    duration = "" if seconds is None else f"{seconds:.1f} s"
    room = width() - len("PASS") - DURATION_WIDTH - 4
    if len(left) > room:
        left = f"{left[: room - 4].rsplit(' ', 1)[0]} ..."
    return f"{left:<{room}}  {pass_or_fail(passed)}  {duration}".rstrip()


def method_lines(checks: Sequence[Check], labels: Mapping[str, str]) -> list[str]:
    """Return a line for each method: how many checks, and the one nearest to its tolerance."""
    groups: dict[str, list[Check]] = {}
    for check in checks:
        label = labels.get(check.method, check.method)
        groups.setdefault(f"{check.variant}: {label}" if check.variant else label, []).append(check)
    worst = {label: max(group, key=_severity) for label, group in groups.items()}
    names = _aligned([*groups])
    numbers = _aligned([str(len(group)) for group in groups.values()], right=True)
    parts = _aligned([_part(check) for check in worst.values()], right=True)
    quantities = _aligned([_name(check) for check in worst.values()])
    errors = [f"{check.worst:.1e} {check.unit}" for check in worst.values()]
    columns = list(zip(names, numbers, parts, quantities, errors, strict=True))
    lines: list[str] = []
    # the first form that fits
    for form in (
        "  {}  {} checks  worst {}  {}  {}",
        "  {}  {} checks  {}  {}  {}",
        "  {}  {} checks  {}  {}",
        "  {}  {}  {}  {}",
    ):
        lines = [form.format(*cells).rstrip() for cells in columns]
        if all(len(line) <= width() for line in lines):
            break
    return lines


def _aligned(cells: Sequence[str], *, right: bool = False) -> list[str]:
    longest = max(map(len, cells), default=0)
    return [cell.rjust(longest) if right else cell.ljust(longest) for cell in cells]


def failure_lines(checks: Sequence[Check], findings: Sequence[Finding], reason: str = "") -> list[str]:
    """Return what is off and by how much, and the likely cause."""
    failed = sorted((check for check in checks if not check.passed), key=_severity, reverse=True)
    shown = failed[:MOST_FAILED]
    explanations = causes(findings)
    label_width = max(map(len, [*map(_name, shown), *(label for label, _ in explanations)]), default=0)
    lines = [line for check in shown for line in labelled(_name(check), _off_by(check), label_width)]
    if len(failed) > len(shown):
        lines.append(f"  and {len(failed) - len(shown)} more failed; -v lists all")
    if not failed and reason:
        lines += labelled("reason", reason, label_width)
    for label, text in explanations:
        lines += labelled(label, text, label_width)
    return lines


def causes(findings: Sequence[Finding]) -> list[tuple[str, str]]:
    """Return what explains a difference: labels and sentences."""
    named = [finding for finding in findings if finding.kind != "none"]
    if not named:
        return [("cause", finding.message) for finding in findings]
    likely = [finding for finding in named if finding.certain]
    if likely:
        return [("likely cause", _explained(finding)) for finding in likely]
    return [("possible cause", _explained(finding)) for finding in named]


def percentage(checks: Sequence[Check]) -> str:
    """Return the largest error as a percentage of its tolerance."""
    return _part(max(checks, key=_severity)) if checks else ""


def _explained(finding: Finding) -> str:
    cause, states_fraction, _ = finding.message.partition(": explains")
    if not states_fraction:
        return finding.message
    return f"{RELATIVE_CHANGE.sub('', cause)}, explains {100.0 * finding.explains:.0f} % of the error"


def _name(check: Check) -> str:
    quantity = check.quantity.removeprefix(f"{check.variant}, ")
    return "loop closure" if quantity == "loop residual" else quantity


def _severity(check: Check) -> float:
    """Return by which fraction of its tolerance a check errs; NaN counts as the largest."""
    if math.isnan(check.worst):
        return math.inf
    return (
        check.fraction_of_tolerance
        if check.fraction_of_tolerance is not None
        else 0.0
        if check.passed
        else math.inf
    )


def _part(check: Check) -> str:
    part = _severity(check)
    if not math.isfinite(part):
        return "inf"
    if part > 10.0:
        return f"{part:.2g} x"
    return f"{100.0 * part:.1f} %" if part >= 1e-3 else "<0.1 %" if part > 0.0 else "0 %"


def _off_by(check: Check) -> str:
    if math.isnan(check.worst):
        return f"not a number at {_instant(check)}"
    tolerance = readable(check.tolerance, check.unit)
    return f"off by {readable(check.worst, check.unit)} at {_instant(check)}   (tolerance {tolerance})"


def _instant(check: Check) -> str:
    if check.at_unit == "rad":
        return f"{math.degrees(check.at) % 360.0:.4g}°"
    return f"row {check.at:g}" if check.at_unit == "row" else f"t = {check.at:.4g} s"


def readable(value: float, unit: str) -> str:
    """Return a quantity with the prefix of its unit that gives a readable number."""
    if unit == "rad" and value >= 1e-6:
        return f"{math.degrees(value):.3g}°"
    if unit.startswith(WITHOUT_PREFIX) or not 1e-9 <= value < 1e6:
        return f"{value:.3g} {unit}" if unit != "1" else f"{value:.3g}"
    return prefixed(value, unit)
