"""What a failed test says: verdict, likely cause, the command that shows it again, the report; 80 columns."""

import textwrap
from pathlib import Path

from mechsim.studies.agreement.agreement import Agreement
from mechsim.verdict.checks import Check

# columns of a terminal, and quantities told of those that are missed
WIDE, FEW = 78, 3


def failure(found: Agreement, command: str, page: Path | None) -> str:
    """Return the message of a failed assertion, lines of 78 columns unless a path or command is longer.

    Args:
        found: what came out.
        command: shows it again.
        page: the report; None where none was written.
    """
    missed = sorted(
        (one for one in found.checks if not one.passed), key=lambda one: -(one.fraction_of_tolerance or 0.0)
    )
    lines = [f"{found.form.name} does not agree with {found.source}"]
    lines += [_missed(check) for check in missed[:FEW]]
    if len(missed) > FEW:
        lines.append(f"  and {len(missed) - FEW} more of {len(found.checks)} quantities")
    cause = cause_of(found)
    lines += _labelled("cause", cause or "none of the known mistakes explains the difference")
    lines.append(f"again:  {command}")
    if page is not None:
        here = page.relative_to(Path.cwd()) if page.is_relative_to(Path.cwd()) else page
        lines.append(f"report: {here}")
    return "\n".join(lines)


def cause_of(found: Agreement) -> str:
    """Return what explains a difference, and how surely; empty where nothing does."""
    sure = [one for one in found.findings if one.certain]
    if sure:
        return " or ".join(one.message for one in sure)
    if not found.findings:
        return ""
    best = found.findings[0]
    return f"perhaps: {best.message} (explains {100.0 * best.explains:.0f} %)"


def _missed(check: Check) -> str:
    said = f"{check.title}: off by {check.worst:.3g} {check.unit}, tolerance {check.tolerance:.3g}"
    return f"  {textwrap.shorten(said, WIDE - 2)}"


def _labelled(label: str, text: str) -> list[str]:
    first = f"{label}:".ljust(8)
    return textwrap.wrap(text, WIDE, initial_indent=first, subsequent_indent=" " * 8)
