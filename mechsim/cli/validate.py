"""The command that checks everything against everything: validate."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from mechsim.analytic import catalog
from mechsim.analytic.forms import Form
from mechsim.cli.against import AgainstOptions, held_against
from mechsim.cli.declared_options import spread
from mechsim.cli.endings import tell
from mechsim.cli.options import DriveOptions, Json, Sets, Speed, folder_for, form_of, moving, speed_of
from mechsim.cli.output import print_json, print_table, progress
from mechsim.cli.scene_findings import found_in, in_json, tell_findings
from mechsim.cli.validate_reference import validate_by_reference
from mechsim.errors import AssemblyError, InputError, MobilityError
from mechsim.report.validation import write_validation_report
from mechsim.studies.validate import Case, validate_all
from mechsim.subjects import gallery
from mechsim.subjects.formula import Formula, formula_file, formula_of
from mechsim.verdict.checks import HEAD


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
    held: AgainstOptions,
    driven: DriveOptions,
    sets: Sets = None,
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
        raise typer.Exit(0 if validate_by_reference(models or (), as_json) else 1)
    if held.against is not None:
        if models is None or len(models) != 1 or whole_gallery:
            raise InputError("--against is of one model; name it, and no others")
        place = None if report is None else folder_for(report)
        held_against(models[0], sets, driven, held, (speed_of(speed), place, as_json))
    if held != AgainstOptions():
        raise InputError(
            "--plot, --tolerance and --all go with --against; say what the model is held against"
        )
    shown = list(gallery.files())
    wanted = list(models or catalog.DRIVES)
    if whole_gallery or not models:
        wanted += shown
    if sets and len(wanted) != 1:
        raise InputError("--set changes one mechanism; name it")
    if driven != DriveOptions() and len(wanted) != 1:
        raise InputError("--drive, --hold, --key and --track are of one mechanism; name it")
    drives = _told_apart({model: moving(form_of(model, sets, driven)) for model in wanted})
    asked = speed_of(speed)
    folder = None if report is None else folder_for(report)
    formulas = _formulas(drives)
    try:
        with progress("validate", len(drives)) as tick:
            quick = () if models or whole_gallery else shown
            cases = validate_all(drives, speed=asked, formulas=formulas, quick=quick, done=tick)
    except (AssemblyError, MobilityError) as error:
        if as_json:
            outcome = error.outcome if isinstance(error, MobilityError) else "cannot assemble"
            lost = {"passed": False, "outcome": outcome, "checks": [], "steps": 0, "seconds": 0.0}
            print_json({"passed": False, "mechanisms": dict.fromkeys(drives, lost)})
        raise
    passed = all(case.passed for case in cases.values())
    scenes = {name: found_in(drive) for name, drive in drives.items()}
    results = {
        "passed": passed,
        "mechanisms": {name: case.as_dict() | in_json(scenes[name]) for name, case in cases.items()},
    }
    if folder is not None:
        with progress("draw", len(cases)) as tick:
            notes = write_validation_report(folder, cases, results, done=tick)
        for note in notes:
            typer.echo(note, err=True)
    if as_json:
        print_json(results)
    else:
        for name, case in cases.items():
            tell_findings(scenes[name])
            _print_case(name, case)
        good = sum(case.passed for case in cases.values())
        typer.echo(f"{good} of {len(cases)} mechanisms met every bound")
        if folder is not None:
            typer.echo(f"report: {folder / 'index.html'}")
    raise typer.Exit(0 if passed else 1)


def _told_apart(forms: Mapping[str, Form]) -> dict[str, Form]:
    """Return mechanisms by name; those of one name by what they were called on the command line."""
    count = Counter(form.name for form in forms.values())
    return {form.name if count[form.name] == 1 else model: form for model, form in forms.items()}


def _formulas(drives: Mapping[str, Form]) -> dict[str, Formula]:
    """Return the formulas by name of the mechanism; says what code of the user's own is run for them."""
    own = dict.fromkeys(file for form in drives.values() if (file := formula_file(form)))
    foreign = [file for file in own if Path(file).resolve().parent != gallery.folder()]
    if foreign:
        tell(f"mechsim: runs {', '.join(foreign)}: a formula is code")
    found = {name: formula_of(form) for name, form in drives.items()}
    return {name: formula for name, formula in found.items() if formula is not None}


def _print_case(name: str, case: Case) -> None:
    title = f"{name}: {case.outcome}" + (f" - {case.reason}" if case.reason else "")
    print_table(title, HEAD, [check.cells for check in case.checks])
