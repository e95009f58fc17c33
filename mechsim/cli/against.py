"""`mechsim validate MODEL --against`: one model held against a function or a table."""

import shutil
import textwrap

import typer

from mechsim.analytic.forms import Form
from mechsim.cli.endings import tell
from mechsim.cli.output import print_json
from mechsim.cli.scene_findings import found_in, in_json, tell_findings
from mechsim.studies.agreement.agreement import Agreement, validate
from mechsim.verdict.checks import Check

# quantities told where not all are asked for
FEW = 4
# characters of the name of a quantity
LONGEST = 36


def held_against(
    model: str, form: Form, against: str, speed: float, *, everything: bool, as_json: bool
) -> None:
    """Say whether a model agrees with a function or a table, and why not; ends the command.

    Args:
        model: as it was called.
        form: what it is.
        against: FILE.py:FUNC or FILE.csv.
        speed: of a crank in [rad/s].
        everything: whether all quantities are told.
        as_json: whether one JSON object is.
    """
    if not against.lower().endswith(".csv"):
        tell(f"mechsim: runs {against.rpartition(':')[0] or against}: a formula is code")
    found = validate(form, against, speed=speed)
    if as_json:
        said = found.as_dict()
        said["findings"] += in_json(found_in(form)).get("findings", [])
        print_json({"passed": found.passed, "mechanisms": {form.name: said}})
    else:
        tell_findings(found_in(form))
        for line in told(form.name, found, everything):
            typer.echo(line)
    raise typer.Exit(0 if found.passed else 1)


def told(name: str, found: Agreement, everything: bool) -> list[str]:
    """Return what is said of one model: a line, the tightest quantities, what explains a difference."""
    shown = sorted(found.checks, key=lambda check: -(check.used or 0.0))
    left = len(shown) - FEW
    lines = [f"{name}: {found.outcome} against {found.source}"]
    lines += [_line(check) for check in (shown if everything else shown[:FEW])]
    if left > 0 and not everything:
        lines.append(f"  {left} more; --all shows them")
    for finding in found.findings:
        likely = "cause" if finding.sure else "perhaps" if finding.kind != "none" else "cause"
        lines += _wrapped(f"{likely}: {finding.say}")
    if "says" in found.attribution:
        lines += _wrapped(str(found.attribution["says"]))
    elif "note" in found.attribution:
        lines += _wrapped(f"not run in time: {found.attribution['note']}")
    return lines


def _wrapped(text: str) -> list[str]:
    """Return text in lines that fit the terminal, those after the first set in."""
    width = max(40, min(shutil.get_terminal_size((80, 24)).columns, 100))
    return textwrap.wrap(text, width, initial_indent="  ", subsequent_indent="    ", break_on_hyphens=False)


def _line(check: Check) -> str:
    said = "met" if check.passed else "MISSED"
    name = textwrap.shorten(check.quantity, LONGEST, placeholder=" ...")
    return f"  {name:<{LONGEST}} {check.worst:8.1e} of {check.bound:7.1e} {check.unit:<6} {said}"
