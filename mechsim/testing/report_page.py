"""A small page on a failed test: verdict, cause, every quantity, the worst one's difference as a curve."""

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
    lines = [f"{found.solver.name} does not agree with {found.source}"]
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


WIDTH, HEIGHT = 640, 200
# characters of a file's name
LONGEST = 80
STYLE = (
    "body{font:15px/1.5 sans-serif;margin:2em auto;max-width:60em;padding:0 1em}"
    "table{border-collapse:collapse}td,th{padding:.2em .8em;text-align:left;border-bottom:1px solid #ccc}"
    ".failed{color:#a00;font-weight:bold}code{background:#eee;padding:.1em .3em}svg{background:#f7f7f7}"
)


def write_page(found: Agreement, command: str, running: RunningTest) -> Path | None:
    """Write the page of a failed test and return its path; None where its folder cannot be written."""
    name = re.sub(r"[^\w.-]+", "-", running.name).strip("-")[-LONGEST:]
    path = running.folder / f"{name}.html"
    try:
        running.folder.mkdir(parents=True, exist_ok=True)
        with atomic_path(path) as beside:
            beside.write_text(page(found, command), encoding="utf-8")
    except (OSError, OutputError):
        return None
    return path


def page(found: Agreement, command: str) -> str:
    """Return the page as HTML that needs nothing beside itself."""
    title = html.escape(f"{found.solver.name} against {found.source}: {found.outcome}")
    rows = "".join(
        f"<tr><td>{html.escape(check.title)}</td><td>{check.worst:.3g}</td><td>{check.tolerance:.3g}</td>"
        f"<td>{html.escape(check.unit)}</td>"
        f"<td{'' if check.passed else ' class=failed'}>{'passed' if check.passed else 'failed'}</td></tr>"
        for check in found.checks
    )
    cause = html.escape(cause_of(found) or "No known mistake explains the difference.")
    causes = (
        "".join(f"<li>{html.escape(one.message)}</li>" for one in found.findings) or "<li>none found</li>"
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>{STYLE}</style>'
        f"<h1>{title}</h1><p>{cause}</p>"
        f"<p>Again: <code>{html.escape(command)}</code></p>{_curve(found)}"
        f"<h2>What was tried</h2><ul>{causes}</ul>"
        f"<h2>Every quantity</h2><table><tr><th>quantity<th>worst<th>tolerance<th>unit<th>result</tr>{rows}"
        "</table></html>\n"
    )


def _curve(found: Agreement) -> str:
    """Return the difference of the quantity that is off most, over the instants compared."""
    used = [check.fraction_of_tolerance or 0.0 for check in found.checks]
    if not used or len(used) != len(found.candidates):
        return ""
    i = int(np.argmax(used))
    off = np.linalg.norm(found.candidates[i].values - found.exact[i], axis=1)
    top = float(off.max(initial=0.0))
    if not 0.0 < top < np.inf:
        return ""
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in _scaled(off / top))
    label = html.escape(f"difference of {found.checks[i].title}, up to {top:.3g} {found.checks[i].unit}")
    return (
        f'<figure><svg viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" role="img" aria-label="{label}">'
        f'<polyline fill="none" stroke="#a00" stroke-width="1.5" points="{points}"/></svg>'
        f"<figcaption>{label}, instant by instant</figcaption></figure>"
    )


def _scaled(part: Array) -> Array:
    """Return values from 0 to 1 as places in the picture, (n, 2)."""
    along = np.linspace(0.0, WIDTH, len(part))
    return np.column_stack([along, HEIGHT - 4.0 - (HEIGHT - 8.0) * part])
