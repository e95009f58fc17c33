"""The command that checks everything against everything: validate."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from mechsim import units
from mechsim.analytic import catalog
from mechsim.analytic.derivatives import DesignFamily
from mechsim.cli.against import AgainstOptions, held_against, tell_code
from mechsim.cli.declared_options import spread
from mechsim.cli.endings import tell
from mechsim.cli.options import DriveOptions, Json, Sets, Speed, Verbose, family_of, folder_for, speed_of
from mechsim.cli.output import print_json, progress
from mechsim.cli.scene_findings import found_in, in_json
from mechsim.cli.validate_reference import validate_by_reference
from mechsim.cli.validation_text import print_cases
from mechsim.errors import AssemblyError, InputError, MobilityError
from mechsim.model.finding import Finding
from mechsim.numerics.angles import TURN
from mechsim.report.validation import write_validation_report
from mechsim.studies.validate import BUDGET, Case, validate_all
from mechsim.subjects import gallery


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
    held: AgainstOptions,
    driven: DriveOptions,
    sets: Sets = None,
    verbose: Verbose = False,
    as_json: Json = False,
) -> None:
    """Check closed form, loop equations, formulas and MuJoCo against each other; the main job.

    The formula that a file names is code, and is run.
    """
    if reference:
        if held != AgainstOptions() or sets or report or whole_gallery or driven != DriveOptions():
            raise InputError(
                "--reference judges what the data describe; leave out all else but names and --json"
            )
        raise typer.Exit(0 if validate_by_reference(models or (), as_json, verbose=verbose) else 1)
    if held.against is not None:
        if models is None or len(models) != 1 or whole_gallery:
            raise InputError("--against is of one model; name it, and no others")
        place = None if report is None else folder_for(report)
        held_against(models[0], sets, driven, held, (speed_of(speed), place, as_json, verbose))
    if held != AgainstOptions(tolerance=held.tolerance):
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
    asked, tolerance = speed_of(speed), held.bound
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
        speed_text = f"{asked * 60.0 / TURN:.4g} rpm"
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
        notes = write_validation_report(folder, cases, results, done=tick)
    for note in notes:
        tell(note)
