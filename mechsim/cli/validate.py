"""The command that checks everything against everything: validate."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from mechsim import units
from mechsim.analytic import catalog
from mechsim.analytic.derivatives import DesignFamily
from mechsim.analytic.forms import Form
from mechsim.cli.declared_options import spread
from mechsim.cli.exit_codes import tell
from mechsim.cli.options import (
    DriveOptions,
    Json,
    Sets,
    Speed,
    Verbose,
    family_of,
    folder_for,
    read_family,
    speed_of,
    writable,
)
from mechsim.cli.output import print_json
from mechsim.cli.progress import progress
from mechsim.cli.verdict_text import (
    agreement_lines,
    attribution_lines,
    found_in,
    in_json,
    print_cases,
    print_verdict,
    print_verdicts,
    tell_findings,
)
from mechsim.errors import AssemblyError, InputError, MobilityError
from mechsim.model.finding import Finding
from mechsim.numerics.angles import REVOLUTION
from mechsim.pictures import plots
from mechsim.pictures.plots.motion import agreement_plot
from mechsim.report.validation import worst_first, write_agreement_report, write_validation_report
from mechsim.studies.agreement.agreement import compare_model
from mechsim.studies.reference import by_reference
from mechsim.studies.validate import BUDGET, Case, validate_all
from mechsim.subjects import gallery, reference_data
from mechsim.subjects.readers import load
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
        "Tolerance on positions. Default: with --against 1e-8 of the workspace, else rounding for the file's "
        "formula and 1e-8 of the stroke or the size for stepped runs; if given, an .xml must satisfy it with "
        "its own settings, too.",
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


@spread
def validate(
    models: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[MODEL]...",
            help="Names, FILE.toml, .xml, FILE.py:OBJECT; none: the catalogue, and the gallery, not stepped.",
        ),
    ] = None,
    *,
    whole_gallery: Annotated[
        bool, typer.Option("--gallery", help="The gallery in full, beside what is named or the catalogue.")
    ] = False,
    reference: Annotated[
        bool,
        typer.Option("--reference", help="Judge both roads by the reference data instead: 30 digits."),
    ] = False,
    report: Annotated[
        str | None, typer.Option(metavar="DIR", help="Write plots, pictures, videos and a page here.")
    ] = None,
    speed: Speed = "600rpm",
    budget: Annotated[
        str,
        typer.Option(
            help="Processor time for the stepped runs of each mechanism; what they reach is reported."
        ),
    ] = f"{BUDGET:g}s",
    compare_model: AgainstOptions,
    driven: DriveOptions,
    sets: Sets = None,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Check closed form, loop equations, formulas and MuJoCo against each other; the main job.

    The formula that a file names is code, and is run.
    """
    if reference:
        if compare_model != AgainstOptions() or sets or report or whole_gallery or driven != DriveOptions():
            raise InputError(
                "--reference judges what the data describe; leave out all else but names and --json"
            )
        raise typer.Exit(0 if validate_by_reference(models or (), as_json, verbose=verbose) else 1)
    if compare_model.against is not None:
        if models is None or len(models) != 1 or whole_gallery:
            raise InputError("--against is of one model; name it, and no others")
        place = None if report is None else folder_for(report)
        held_against(models[0], sets, driven, compare_model, (speed_of(speed), place, as_json, verbose))
    if compare_model != AgainstOptions(tolerance=compare_model.tolerance):
        raise InputError("--plot goes with --against; name what the model is compared with")
    shown = list(gallery.files())
    wanted = list(models or catalog.DRIVES)
    if whole_gallery or not models:
        wanted += shown
    if sets and len(wanted) != 1:
        raise InputError("--set changes one mechanism; name it")
    if driven != DriveOptions() and len(wanted) != 1:
        raise InputError("--drive, --lock, --key and --track are of one mechanism; name it")
    families = _told_apart({model: family_of(model, sets, driven) for model in wanted})
    asked, tolerance = speed_of(speed), compare_model.bound
    folder = None if report is None else folder_for(report)
    tell_code([family.make({}) for family in families.values()])
    quick = () if models or whole_gallery else shown
    seconds = units.parse_time(budget, "the budget")
    cases = _validated(families, (asked, tolerance, seconds), quick, as_json)
    scenes = {name: _findings(case) for name, case in cases.items()}
    passed = all(case.passed for case in cases.values())
    results = {
        "passed": passed,
        "mechanisms": {name: case.as_dict() | in_json(scenes[name]) for name, case in cases.items()},
    }
    if folder is not None:
        _write_report(folder, cases, results)
    if as_json:
        print_json(results)
    else:
        speed_text = f"{asked * 60.0 / REVOLUTION:.4g} rpm"
        print_cases(cases, scenes, speed_text, verbose=verbose)
        if folder is not None:
            typer.echo(f"report: {folder / 'index.html'}")
    raise typer.Exit(0 if passed else 1)


def _told_apart(families: Mapping[str, DesignFamily]) -> dict[str, DesignFamily]:
    """Return mechanisms by name; those of one name by what they were called on the command line."""
    names = {model: family.make({}).name for model, family in families.items()}
    count = Counter(names.values())
    return {names[model] if count[names[model]] == 1 else model: family for model, family in families.items()}


def _validated(
    families: Mapping[str, DesignFamily],
    asked: tuple[float, float | None, float],
    quick: Sequence[str],
    as_json: bool,
) -> dict[str, Case]:
    """Return the cases; where one cannot be judged JSON says so before the command ends."""
    try:
        with progress("validate", None) as tick:
            speed, tolerance, budget = asked
            return validate_all(
                families, speed=speed, quick=quick, tolerance=tolerance, budget=budget, watch=tick
            )
    except (AssemblyError, MobilityError) as error:
        if as_json:
            outcome = error.outcome if isinstance(error, MobilityError) else "cannot assemble"
            lost = {"passed": False, "outcome": outcome, "checks": [], "steps": 0, "seconds": 0.0}
            told = {name: lost | in_json(found_in(one.make({}))) for name, one in families.items()}
            print_json({"passed": False, "mechanisms": told})
        raise


def _findings(case: Case) -> tuple[Finding, ...] | None:
    """Return what is wrong with an MJCF file, and what it does with its own settings; None of others."""
    found = found_in(case.drive)
    if found is None or case.published is None:
        return found
    return (*found, case.published.finding())


def _write_report(folder: Path, cases: Mapping[str, Case], results: Mapping[str, Any]) -> None:
    with progress("draw", len(cases)) as tick:
        descriptions = {name: gallery.description(path) for name, path in gallery.files().items()}
        notes = write_validation_report(folder, cases, results, tick, descriptions)
    for note in notes:
        tell(note)


def validate_by_reference(models: Sequence[str], as_json: bool, *, verbose: bool) -> bool:
    """Judge the mechanisms named, or all of the reference data, and print it; return whether all are met.

    Raises:
        InputError: for a name of which there are no data, or data that are not what their checksum says.
    """
    where = reference_data.folder()
    tables = [reference_data.read(where, name) for name in models or reference_data.names(where)]
    cases: dict[str, Verdict] = {}
    with progress("validate", len(tables)) as tick:
        for table in tables:
            closed = catalog.make(table.name) if table.name in catalog.DRIVES else None
            cases[table.name] = by_reference(load(str(table.mechanism)), table, closed)
            tick(table.name)
    passed = all(case.passed for case in cases.values())
    if as_json:
        print_json({"passed": passed, "mechanisms": {name: case.as_dict() for name, case in cases.items()}})
        return passed
    print_verdicts(cases, verbose=verbose)
    count = sum(case.passed for case in cases.values())
    typer.echo(f"{count} of {len(cases)} mechanisms agree with the reference data in {where}")
    return passed


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
        plots.format_of(place)
    bound = asked.bound
    if not source.lower().endswith(".csv"):
        tell(f"mechsim: runs {source.rpartition(':')[0] or source}: a formula is code")
    found = compare_model(read_family(model, sets, driven), source, speed=speed, tolerance=bound)
    name, scene = found.solver.name, found_in(found.solver) or ()
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
