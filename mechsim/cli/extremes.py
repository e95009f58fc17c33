"""Command that pushes every axis until something breaks: extremes."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mechsim.analytic.forms import closed_form
from mechsim.cli.options import Json, folder_for, form_of
from mechsim.cli.output import print_json, print_table
from mechsim.cli.progress import progress
from mechsim.files import write_json

if TYPE_CHECKING:
    from mechsim.studies.extremes import StabilityMap


def extremes(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME]...", help="Mechanisms of the catalogue; none means all."),
    ] = None,
    report: Annotated[
        str | None, typer.Option(metavar="DIR", help="Write the map and all numbers here.")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer values, shorter runs.")] = False,
    as_json: Json = False,
) -> None:
    """Push steps, speed, size, masses, poses, turns and gears until something breaks; say where it does."""
    from mechsim.studies.extremes.stability_map import study

    for name in names or ():
        closed_form(form_of(name, None), "how far it can be pushed")
    folder = None if report is None else folder_for(report)

    with progress("extremes", None) as tick:
        found = study(names, quick=quick, progress=tick)
    if folder is not None:
        _write(folder, found)
    if as_json:
        print_json(found.as_dict())
    else:
        _print(found)
        if folder is not None:
            typer.echo(f"map: {folder / 'extremes.svg'}")
    raise typer.Exit(0 if found.passed else 1)


def _write(folder: Path, found: "StabilityMap") -> None:
    from mechsim.pictures import plots
    from mechsim.studies.extremes.plot import extremes_map

    folder.mkdir(exist_ok=True)
    plots.write(folder / "extremes.svg", extremes_map(found))
    write_json(folder / "extremes.json", found.as_dict())


def _print(found: "StabilityMap") -> None:
    rows = [
        (b.axis, b.mechanism, f"{b.inside:.2g}", b.before, f"{b.outside:.2g}", b.after) for b in found.borders
    ]
    print_table("Borders", ("axis", "mechanism", "up to", "", "from", ""), rows)
    if found.drifts:
        _print_drifts(found)
    for trial in found.wrong:
        foretold = f", foretold {trial.expected}" if trial.expected else ""
        typer.echo(
            f"WRONG: {trial.mechanism}, {trial.axis} {trial.value:.3g}: said {trial.outcome}, "
            f"right {trial.right}{foretold}"
        )
    good = len(found.trials) - len(found.wrong)
    typer.echo(f"{good} of {len(found.trials)} runs ended as the closed form says, and knew it")


def _print_drifts(found: "StabilityMap") -> None:
    rows = [
        (d.mechanism, f"{d.turns:g}", f"{d.first:.3e}", f"{d.last:.3e}", "no drift" if d.passed else "DRIFTS")
        for d in found.drifts
    ]
    title = "Many turns: place error / size in the first and last hundredth"
    print_table(title, ("mechanism", "turns", "first", "last", ""), rows)
