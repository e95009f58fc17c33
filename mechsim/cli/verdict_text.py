"""Verdicts and findings as text: a line per method, the failed checks with their cause, or tables."""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from mechsim.cli.finding_text import kind, print_finding_lines
from mechsim.cli.output import labelled, pass_or_fail, print_table, print_text, width, wrapped
from mechsim.errors import several
from mechsim.mechanism.finding import Finding, counted_findings
from mechsim.mechanism.masses import summary
from mechsim.pictures.number_text import quantity_text

if TYPE_CHECKING:
    from mechsim.compare.checks import Check, Verdict
    from mechsim.studies.agreement.agreement import Agreement
    from mechsim.studies.validate import Validation


# method of a verdict -> description of its comparison
METHODS = {
    "formula": "formula vs loop equations",
    "pose": "MuJoCo, solved poses",
    "step": "MuJoCo, stepped",
    "as published": "MuJoCo, the file's own settings",
}
# maximum number of failed checks in the output without -v
MAX_FAILED = 3
# columns reserved for the duration of a validation
DURATION_WIDTH = 6
# as in "rod is 0.199 m instead of 0.2 m (-0.5 %)"
RELATIVE_CHANGE = re.compile(r" \([-+]\S+ %\)")


def print_verdict(title: str, verdict: "Verdict") -> None:
    """Print a verdict and a table of all its checks, with the reason for each tolerance."""
    from mechsim.compare.checks import check_table

    head, rows = check_table(verdict.checks)
    print_text(f"{title}: {verdict.outcome}" + (f" - {verdict.reason}" if verdict.reason else ""))
    print_table("", head, rows)


def print_verdicts(verdicts: "Mapping[str, Verdict]", *, verbose: bool) -> None:
    """Print a line for each verdict, failures with their errors first; print all checks if verbose."""
    for name, verdict in verdicts.items():
        if verbose:
            print_verdict(name, verdict)
        elif not verdict.passed:
            _echo([headline(name, verdict.passed), *failure_lines(verdict.checks, (), verdict.reason)])
    print_summary(verdicts, {})


def _echo(lines: Sequence[str]) -> None:
    for line in lines:
        typer.echo(line)


def print_summary(verdicts: "Mapping[str, Verdict]", findings: Mapping[str, int]) -> None:
    """Print a line for each verdict: number of checks, PASS or FAIL, largest error / tolerance."""
    longest = max(map(len, verdicts), default=0)
    for name, verdict in verdicts.items():
        worst = max(verdict.checks, key=attrgetter("severity"), default=None)
        typer.echo(
            f"  {name:<{longest}}  {len(verdict.checks):>4} checks   "
            f"{pass_or_fail(verdict.passed, findings.get(name, 0))}  "
            f"{'' if worst is None else _fraction(worst):>7}"
        )


def headline(title: str, passed: bool, seconds: float | None = None, findings: int = 0) -> str:
    """Return a title with PASS, with the number of findings, or FAIL, and the duration at the right edge."""
    duration = "" if seconds is None else f"{seconds:.1f} s"
    columns = width() - len(f"PASS{counted_findings(findings)}") - DURATION_WIDTH - 4
    if len(title) > columns:
        title = f"{title[: columns - 4].rsplit(' ', 1)[0]} ..."
    return f"{title:<{columns}}  {pass_or_fail(passed, findings)}  {duration}".rstrip()


def method_lines(checks: "Sequence[Check]", labels: Mapping[str, str]) -> list[str]:
    """Return a line for each method: the number of checks, and the check nearest to its tolerance."""
    groups: dict[str, list[Check]] = {}
    for check in checks:
        label = labels.get(check.method, check.method)
        groups.setdefault(f"{check.variant}: {label}" if check.variant else label, []).append(check)
    worst = {label: max(group, key=attrgetter("severity")) for label, group in groups.items()}
    columns = (
        _aligned([*groups], str.ljust),
        _aligned([str(len(group)) for group in groups.values()], str.rjust),
        _aligned([_fraction(check) for check in worst.values()], str.rjust),
        _aligned([_name(check) for check in worst.values()], str.ljust),
        [f"{check.worst:.1e} {check.unit}" for check in worst.values()],
    )
    lines: list[str] = []
    # select the first layout that fits
    for layout in (
        "  {}  {} checks  worst {}  {}  {}",
        "  {}  {} checks  {}  {}  {}",
        "  {}  {} checks  {}  {}",
        "  {}  {}  {}  {}",
    ):
        lines = [layout.format(*row).rstrip() for row in zip(*columns, strict=True)]
        if all(len(line) <= width() for line in lines):
            break
    return lines


def _aligned(texts: Sequence[str], justify: Callable[[str, int], str]) -> list[str]:
    longest = max(map(len, texts), default=0)
    return [justify(text, longest) for text in texts]


def failure_lines(checks: "Sequence[Check]", findings: Sequence[Finding], reason: str = "") -> list[str]:
    """Return the failed checks with their errors, and the likely cause."""
    failed = sorted((check for check in checks if not check.passed), key=attrgetter("severity"), reverse=True)
    shown = failed[:MAX_FAILED]
    explanations = causes(findings)
    label_width = max(map(len, [*map(_name, shown), *(label for label, _ in explanations)]), default=0)
    lines = [line for check in shown for line in labelled(_name(check), _off_by(check), label_width)]
    if len(failed) > len(shown):
        lines.append(f"  and {len(failed) - len(shown)} more failed; -v lists all")
    if not failed and reason:
        explanations = [("reason", reason), *explanations]
    for label, text in explanations:
        lines += labelled(label, text, label_width)
    return lines


def causes(findings: Sequence[Finding]) -> list[tuple[str, str]]:
    """Return the causes of a difference: labels and sentences."""
    named = [finding for finding in findings if finding.kind != "none"]
    if not named:
        return [("cause", finding.message) for finding in findings]
    likely = [finding for finding in named if finding.certain]
    label = "likely cause" if likely else "possible cause"
    return [(label, _explained(finding)) for finding in likely or named]


def _explained(finding: Finding) -> str:
    cause, states_fraction, _ = finding.message.partition(": explains")
    if not states_fraction:
        return finding.message
    return f"{RELATIVE_CHANGE.sub('', cause)}, explains {100.0 * finding.explains:.0f} % of the error"


def _name(check: "Check") -> str:
    quantity = check.quantity.removeprefix(f"{check.variant}, ")
    return "loop closure" if quantity == "loop residual" else quantity


def _fraction(check: "Check") -> str:
    fraction = check.severity
    if not math.isfinite(fraction):
        return "inf"
    if fraction > 10.0:
        return f"{fraction:.2g} x"
    return f"{100.0 * fraction:.1f} %" if fraction >= 1e-3 else "<0.1 %" if fraction > 0.0 else "0 %"


def _off_by(check: "Check") -> str:
    if check.at_unit == "rad":
        instant = f"{math.degrees(check.instant) % 360.0:.4g}°"
    else:
        instant = f"row {check.instant:g}" if check.at_unit == "row" else f"t = {check.instant:.4g} s"
    if math.isnan(check.worst):
        return f"not a number at {instant}"
    tolerance = quantity_text(check.tolerance, check.unit)
    return f"off by {quantity_text(check.worst, check.unit)} at {instant}   (tolerance {tolerance})"


def print_agreement(name: str, agreement: "Agreement", *, verbose: bool, findings: int = 0) -> None:
    """Print the result for one model: PASS, with findings in its file, or FAIL with the likely cause."""
    # of a long path the file's name is enough
    source = agreement.source if len(agreement.source) < width() // 2 else Path(agreement.source).name
    lines = [headline(f"{name} vs {source}", agreement.passed, findings=findings)]
    if agreement.passed:
        lines += method_lines(agreement.checks, {"": "compared"})
    else:
        lines += failure_lines(agreement.checks, agreement.findings, agreement.reason)
    lines += wrapped(summary(agreement.masses))
    _echo([*lines, *(attribution_lines(agreement) if verbose else ())])
    if verbose:
        from mechsim.compare.checks import Verdict

        print_verdict(name, Verdict(agreement.outcome, agreement.checks, agreement.reason))


def attribution_lines(agreement: "Agreement") -> list[str]:
    """Return the contributions to the error of a stepped run."""
    if "says" in agreement.attribution:
        return wrapped(str(agreement.attribution["says"]))
    if "note" in agreement.attribution:
        return wrapped(f"not stepped: {agreement.attribution['note']}")
    return []


def print_cases(cases: Mapping[str, "Validation"], speed: str, *, verbose: bool) -> None:
    """Print the results of `mechsim validate`: failures first, with their cause.

    Args:
        cases: results by name.
        speed: speed of the crank, as text.
        verbose: whether all checks are listed.
    """
    single = len(cases) == 1
    for name, case in cases.items():
        print_finding_lines(case.file_findings)
        if verbose or single or not case.passed:
            _print_block(name, case, speed, verbose)
    if single:
        (case,) = cases.values()
        failed = sum(not check.passed for check in case.verdict.checks)
        count = len(case.verdict.checks)
        result = (
            f"{several(count, 'check')} passed{counted_findings(case.warnings)}"
            if case.passed
            else f"{failed} of {count} checks failed"
            if failed
            else "a comparison failed without a check"
        )
        hints = "" if verbose else "; -v lists all, --report DIR writes HTML"
        typer.echo(f"{result} (% = error/tolerance{hints})")
    else:
        verdicts = {name: case.verdict for name, case in cases.items()}
        print_summary(verdicts, {name: case.warnings for name, case in cases.items()})
        passed = sum(case.passed for case in cases.values())
        typer.echo(
            f"  {passed} passed, {len(cases) - passed} failed in "
            f"{sum(case.seconds for case in cases.values()):.1f} s   (% = error/tolerance)"
        )
    if posed := sum(case.quick for case in cases.values()):
        mechanisms, them = ("mechanism", "it") if posed == 1 else ("mechanisms", "them")
        typer.echo(f"  ({posed} gallery {mechanisms}: solved poses only; --gallery also steps {them})")


def _print_block(name: str, case: "Validation", speed: str, verbose: bool) -> None:
    """Print the comparisons of a mechanism, and the failures."""
    lines = [headline(f"{name}  {kind(case.solver)}", case.passed, case.seconds, case.warnings)]
    if not case.passed:
        for finding in case.file_findings or ():
            if finding.kind == "published" and finding.severity == "error":
                lines += labelled("remedy", finding.remedy, len("remedy"))
        findings = () if case.formula is None else case.formula.findings
        lines += failure_lines(case.verdict.checks, findings, case.verdict.reason)
    if not case.solver.motion_laws.crank:
        speed = "motion laws"
    integrator = "" if case.run.settings is None else f", {case.run.settings.integrator}"
    stepped = f"MuJoCo, {speed}{integrator}, {case.run.steps} steps"
    lines += method_lines(case.verdict.checks, METHODS | {"step": stepped})
    lines += [line for note in _notes(case) for line in wrapped(note)]
    if verbose and case.formula is not None:
        lines += attribution_lines(case.formula)
    _echo(lines)
    if verbose:
        print_verdict(name, case.verdict)


def _notes(case: "Validation") -> list[str]:
    """Return further remarks on a stepped run."""
    from mechsim.simulation.settings import COMPLIANCE

    notes: list[str] = []
    if case.compliance not in (None, COMPLIANCE):
        notes.append(
            f"stepped with compliance scale {case.compliance:.2g} of the loops, not {COMPLIANCE:.2g}"
        )
    run = case.run
    if run.note.startswith("not stepped"):
        notes.append(run.note)
    if case.published is not None and run.settings is not None and run.timestep is not None:
        own = ", ".join(f"{name} {value}" for name, value in run.settings.rows().items())
        notes.append(f"stepped with mechsim's settings: timestep {1e3 * run.timestep:.3g} ms, {own}")
    return notes
