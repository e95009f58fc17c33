"""`mechsim validate MODEL --against`: one model held against a function or a table."""

import math
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
from mechsim.cli.terminal import wrapped
from mechsim.cli.verdict_text import failure_lines, headline, method_lines, print_verdict
from mechsim.errors import InputError
from mechsim.model.masses import summary
from mechsim.pictures import plots
from mechsim.pictures.plots.agreement import agreement_plot
from mechsim.report.agreement import worst_first, write_agreement_report
from mechsim.studies.agreement.agreement import Agreement, held
from mechsim.subjects import gallery
from mechsim.units import option
from mechsim.verdict.checks import Verdict


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
    output: tuple[float, Path | None, bool, bool],
) -> NoReturn:
    """Say whether a model agrees with a function or a table, and why not; ends the command.

    Args:
        model: as it was called.
        sets: its changed parameters, as NAME=VALUE.
        driven: how it is driven.
        asked: against what it is held, and how that is told.
        output: speed of a crank in [rad/s], folder for a page or None, whether JSON is printed, and whether
            all checks are listed.
    """
    speed, report, as_json, verbose = output
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
        for line in agreement_lines(name, found):
            typer.echo(line)
        if verbose:
            for line in attribution_lines(found):
                typer.echo(line)
            print_verdict(name, Verdict(found.outcome, found.checks, found.reason))
        if report is not None:
            typer.echo(f"report: {report / 'index.html'}")
    raise typer.Exit(0 if found.passed else 1)


def tell_code(forms: Iterable[Form]) -> None:
    """Say what code of the user's own is run for the formulas that files name."""
    files = [form.formula.rpartition(":")[0] for form in forms]
    own = [file for file in dict.fromkeys(files) if file and Path(file).resolve().parent != gallery.folder()]
    if own:
        tell(f"mechsim: runs {', '.join(own)}: a formula is code")


def agreement_lines(name: str, agreement: Agreement) -> list[str]:
    """Return the result for one model: PASS or FAIL, what is off, and the likely cause."""
    lines = [headline(f"{name} vs {agreement.source}", agreement.passed)]
    if agreement.passed:
        lines += method_lines(agreement.checks, {"": "compared"})
    else:
        lines += failure_lines(agreement.checks, agreement.findings, agreement.reason)
    lines += wrapped(agreement.noise_report)
    if agreement.masses:
        lines += wrapped(summary(agreement.masses))
    return lines


def attribution_lines(agreement: Agreement) -> list[str]:
    """Return which part of the error of a stepped run comes from where."""
    if "says" in agreement.attribution:
        return wrapped(str(agreement.attribution["says"]))
    if "note" in agreement.attribution:
        return wrapped(f"not stepped: {agreement.attribution['note']}")
    return []
