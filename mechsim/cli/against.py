"""`mechsim validate MODEL --against`: one model held against a function or a table."""

import math
import shutil
import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

import typer

from mechsim import units
from mechsim.analytic.forms import Form
from mechsim.cli.endings import tell
from mechsim.cli.options import DriveOptions, read_family, writable
from mechsim.cli.output import print_json
from mechsim.cli.scene_findings import found_in, tell_findings
from mechsim.errors import InputError
from mechsim.model.masses import summary
from mechsim.pictures import plots
from mechsim.pictures.plots.agreement import agreement_plot
from mechsim.report.agreement import worst_first, write_agreement_report
from mechsim.studies.agreement.agreement import Agreement, held
from mechsim.subjects import gallery
from mechsim.units import option
from mechsim.verdict.checks import Check

# quantities told where not all are asked for
FEW = 4
# characters of the name of a quantity
LONGEST = 36


@dataclass(frozen=True, slots=True, kw_only=True)
class AgainstOptions:
    """Against what one model is held, and how that is told."""

    against: str | None = option(
        None,
        "Hold one model against a function of your own, which is run, or a table.",
        metavar="FILE.py:FUNC|FILE.csv",
    )
    tolerance: str | None = option(
        None,
        "Tolerance on positions. Default: with --against 1e-8 of the workspace, else (stepped runs) 1e-8 of "
        "the stroke or the size; if given, an .xml must satisfy it with its own settings, too.",
    )
    plot: str | None = option(None, "Draw the quantity farthest off with --against.", metavar="FILE")
    everything: bool = option(False, "Print every quantity, not the tightest only.", name="--all")

    @property
    def bound(self) -> float | None:
        """The tolerance in [m]; None where none is given."""
        if self.tolerance is None:
            return None
        bound = units.parse_length(self.tolerance, "the tolerance")
        if not 0.0 < bound < math.inf:
            raise InputError(f"--tolerance is {self.tolerance}; give a length above 0, as in 1um")
        return bound


def held_against(
    model: str,
    sets: list[str] | None,
    driven: DriveOptions,
    asked: AgainstOptions,
    told_how: tuple[float, Path | None, bool],
) -> NoReturn:
    """Say whether a model agrees with a function or a table, and why not; ends the command.

    Args:
        model: as it was called.
        sets: its changed parameters, as NAME=VALUE.
        driven: how it is driven.
        asked: against what it is held, and how that is told.
        told_how: speed of a crank in [rad/s], folder for a page or None, whether JSON is printed.
    """
    speed, report, as_json = told_how
    source = asked.against or ""
    place = None if asked.plot is None else writable(asked.plot)
    if place is not None:
        plots.form_of(place)
    bound = asked.bound
    if not source.lower().endswith(".csv"):
        tell(f"mechsim: runs {source.rpartition(':')[0] or source}: a formula is code")
    found = held(read_family(model, sets, driven), source, speed=speed, tolerance=bound)
    name, scene = found.form.name, found_in(found.form) or ()
    told_of = found.as_dict()
    told_of["findings"] = [one.as_dict() for one in (*scene, *found.findings)]
    results = {"passed": found.passed, "mechanisms": {name: told_of}}
    if place is not None:
        plots.write(place, agreement_plot(worst_first(found)[0]))
    notes = [] if report is None else write_agreement_report(report, found, results)
    for note in notes:
        tell(note)
    if as_json:
        print_json(results)
    else:
        tell_findings(scene)
        for line in told(name, found, asked.everything):
            typer.echo(line)
        if report is not None:
            typer.echo(f"report: {report / 'index.html'}")
    raise typer.Exit(0 if found.passed else 1)


def tell_code(forms: Iterable[Form]) -> None:
    """Say what code of the user's own is run for the formulas that files name."""
    files = [form.formula.rpartition(":")[0] for form in forms]
    own = [file for file in dict.fromkeys(files) if file and Path(file).resolve().parent != gallery.folder()]
    if own:
        tell(f"mechsim: runs {', '.join(own)}: a formula is code")


def told(name: str, found: Agreement, everything: bool) -> list[str]:
    """Return what is said of one model: a line, the tightest quantities, what explains a difference."""
    shown = sorted(found.checks, key=lambda check: -(check.used or 0.0))
    left = len(shown) - FEW
    lines = [f"{name}: {found.outcome} against {found.source}"]
    lines += [_line(check) for check in (shown if everything else shown[:FEW])]
    if left > 0 and not everything:
        lines.append(f"  {left} more; --all shows them")
    return lines + _wrapped(found.noise_report) + explained(found)


def explained(found: Agreement) -> list[str]:
    """Return what explains a difference, and where that of a run in time comes from."""
    lines = _wrapped(summary(found.masses)) if found.masses else []
    for finding in found.findings:
        likely = "" if finding.kind == "none" else "cause: " if finding.sure else "perhaps: "
        lines += _wrapped(f"{likely}{finding.say}")
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
