"""A report of a failed test: verdict, cause, all quantities, and a plot of the largest difference."""

import html
import re
import textwrap
from pathlib import Path

import numpy as np

from mechsim.errors import OutputError
from mechsim.files import atomic_path
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.agreement import Agreement
from mechsim.testing.running import RunningTest
from mechsim.verdict.checks import Check

# width in characters, and number of failed quantities in a message
WIDTH_OF_MESSAGE, MAX_LISTED = 78, 3


def failure(agreement: Agreement, command: str, page: Path | None) -> str:
    """Return the message of a failed assertion, lines of 78 columns unless a path or command is longer.

    Args:
        agreement: the result.
        command: command that repeats the comparison.
        page: path of the report; None if it was not written.
    """
    failed = sorted(
        (check for check in agreement.checks if not check.passed), key=lambda check: -check.severity
    )
    lines = [f"{agreement.solver.name} does not agree with {agreement.source}"]
    lines += [_failed_check(check) for check in failed[:MAX_LISTED]]
    if len(failed) > MAX_LISTED:
        lines.append(f"  and {len(failed) - MAX_LISTED} more of {len(agreement.checks)} quantities")
    cause = cause_of(agreement)
    lines += _labelled("cause", cause or "none of the known mistakes explains the difference")
    lines.append(f"again:  {command}")
    if page is not None:
        shown = page.relative_to(Path.cwd()) if page.is_relative_to(Path.cwd()) else page
        lines.append(f"report: {shown}")
    return "\n".join(lines)


def cause_of(agreement: Agreement) -> str:
    """Return the likely cause of a difference, with its certainty; empty if there is none."""
    certain = [finding for finding in agreement.findings if finding.certain]
    if certain:
        return " or ".join(finding.message for finding in certain)
    if not agreement.findings:
        return ""
    best = agreement.findings[0]
    return f"perhaps: {best.message} (explains {100.0 * best.explains:.0f} %)"


def _failed_check(check: Check) -> str:
    text = f"{check.title}: off by {check.worst:.3g} {check.unit}, tolerance {check.tolerance:.3g}"
    return f"  {textwrap.shorten(text, WIDTH_OF_MESSAGE - 2)}"


def _labelled(label: str, text: str) -> list[str]:
    first = f"{label}:".ljust(8)
    return textwrap.wrap(text, WIDTH_OF_MESSAGE, initial_indent=first, subsequent_indent=" " * 8)


# size of a plot in pixels of the page
WIDTH, HEIGHT = 640, 200
# largest number of characters of a file name
MAX_LENGTH = 80
STYLE = (
    "body{font:15px/1.5 sans-serif;margin:2em auto;max-width:60em;padding:0 1em}"
    "table{border-collapse:collapse}td,th{padding:.2em .8em;text-align:left;border-bottom:1px solid #ccc}"
    ".failed{color:#a00;font-weight:bold}code{background:#eee;padding:.1em .3em}svg{background:#f7f7f7}"
)


def write_page(agreement: Agreement, command: str, running: RunningTest) -> Path | None:
    """Write the report of a failed test and return its path; None if its folder cannot be written."""
    name = re.sub(r"[^\w.-]+", "-", running.name).strip("-")[-MAX_LENGTH:]
    path = running.folder / f"{name}.html"
    try:
        running.folder.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as temporary:
            temporary.write_text(page(agreement, command), encoding="utf-8")
    except (OSError, OutputError):
        return None
    return path


def page(agreement: Agreement, command: str) -> str:
    """Return the report as self-contained HTML."""
    title = html.escape(f"{agreement.solver.name} against {agreement.source}: {agreement.outcome}")
    rows = "".join(
        f"<tr><td>{html.escape(check.title)}</td><td>{check.worst:.3g}</td><td>{check.tolerance:.3g}</td>"
        f"<td>{html.escape(check.unit)}</td>"
        f"<td{'' if check.passed else ' class=failed'}>{'passed' if check.passed else 'failed'}</td></tr>"
        for check in agreement.checks
    )
    cause = html.escape(cause_of(agreement) or "No known mistake explains the difference.")
    causes = (
        "".join(f"<li>{html.escape(finding.message)}</li>" for finding in agreement.findings)
        or "<li>none found</li>"
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
        f"<h1>{title}</h1><p>{cause}</p>"
        f"<p>Again: <code>{html.escape(command)}</code></p>{_curve(agreement)}"
        f"<h2>Possible causes</h2><ul>{causes}</ul>"
        f"<h2>All quantities</h2><table><tr><th>quantity<th>worst<th>tolerance<th>unit<th>result</tr>{rows}"
        "</table></html>\n"
    )


def _curve(agreement: Agreement) -> str:
    """Return a plot of the quantity with the largest relative difference, over the compared instants."""
    used = [check.severity for check in agreement.checks]
    if not used or len(used) != len(agreement.candidates):
        return ""
    i = int(np.argmax(used))
    off = np.linalg.norm(agreement.candidates[i].values - agreement.exact[i], axis=1)
    top = float(off.max(initial=0.0))
    if not 0.0 < top < np.inf:
        return ""
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in _scaled(off / top))
    label = html.escape(
        f"difference of {agreement.checks[i].title}, up to {top:.3g} {agreement.checks[i].unit}"
    )
    return (
        f'<figure><svg viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" role="img" aria-label="{label}">'
        f'<polyline fill="none" stroke="#a00" stroke-width="1.5" points="{points}"/></svg>'
        f"<figcaption>{label}, over the instants</figcaption></figure>"
    )


def _scaled(fraction: Array) -> Array:
    """Return values from 0 to 1 as points of the plot, (n, 2)."""
    along = np.linspace(0.0, WIDTH, len(fraction))
    return np.column_stack([along, HEIGHT - 4.0 - (HEIGHT - 8.0) * fraction])
