"""The command that checks everything against everything: validate."""

from typing import Annotated

import typer

from mechsim.analytic import catalog
from mechsim.cli.options import Json, Sets, Speed, folder_for, form_of, speed_of
from mechsim.cli.output import print_json, print_table, progress
from mechsim.errors import AssemblyError, InputError, MobilityError
from mechsim.report.validation import write_validation_report
from mechsim.studies.validate import Case, validate_all
from mechsim.verdict.checks import HEAD


def validate(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[MODEL]...", help="Names, FILE.toml, FILE.py:OBJECT; none: the catalogue."),
    ] = None,
    report: Annotated[
        str | None, typer.Option(metavar="DIR", help="Write plots, pictures, videos and a page here.")
    ] = None,
    speed: Speed = "600rpm",
    sets: Sets = None,
    as_json: Json = False,
) -> None:
    """Check closed form, loop equations and MuJoCo against each other; the main job."""
    names = names or list(catalog.DRIVES)
    if sets and len(names) != 1:
        raise InputError("--set changes one mechanism; name it")
    drives = [form_of(name, sets) for name in names]
    asked = speed_of(speed)
    folder = None if report is None else folder_for(report)
    try:
        with progress("validate", len(drives)) as tick:
            cases = validate_all(drives, speed=asked, done=lambda case: tick(case.drive.name))
    except (AssemblyError, MobilityError) as error:
        if as_json:
            outcome = error.outcome if isinstance(error, MobilityError) else "cannot assemble"
            lost = {"passed": False, "outcome": outcome, "checks": [], "steps": 0, "seconds": 0.0}
            print_json({"passed": False, "mechanisms": dict.fromkeys([drive.name for drive in drives], lost)})
        raise
    passed = all(case.passed for case in cases.values())
    results = {"passed": passed, "mechanisms": {name: case.as_dict() for name, case in cases.items()}}
    if folder is not None:
        with progress("draw", len(cases)) as tick:
            notes = write_validation_report(folder, cases, results, done=tick)
        for note in notes:
            typer.echo(note, err=True)
    if as_json:
        print_json(results)
    else:
        for name, case in cases.items():
            _print_case(name, case)
        good = sum(case.passed for case in cases.values())
        typer.echo(f"{good} of {len(cases)} mechanisms met every bound")
        if folder is not None:
            typer.echo(f"report: {folder / 'index.html'}")
    raise typer.Exit(0 if passed else 1)


def _print_case(name: str, case: Case) -> None:
    title = f"{name}: {case.outcome}" + (f" - {case.reason}" if case.reason else "")
    print_table(title, HEAD, [check.cells for check in case.checks])
