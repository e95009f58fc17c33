"""Command `mechsim extremes`: varies every axis until a run fails."""

from typing import Annotated

import typer

from mechsim.cli.command import Result, command
from mechsim.cli.options import ModelOptions, complete_models
from mechsim.cli.output import number, print_table, print_text
from mechsim.cli.progress import progress
from mechsim.studies.extremes.trial import StabilityMap
from mechsim.units import option


@command
def extremes(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[MODEL]...",
            help="Models; size is varied for the catalogue only. Default: the catalogue.",
            autocompletion=complete_models,
        ),
    ] = None,
    quick: bool = option(False, "Test fewer values.", name="--quick"),
) -> Result:
    """Vary steps, speed, size, masses and initial poses until a run fails, and report where.

    Examples:
    mechsim extremes four_bar --quick
    mechsim extremes --json
    """
    from mechsim.studies.extremes.stability_map import study

    solvers = [ModelOptions(model=name).load_moving() for name in names or ()]
    with progress("extremes", None) as report:
        result = study(solvers, quick=quick, progress=report)
    return Result(result, lambda: _print(result), result.passed)


def _print(result: StabilityMap) -> None:
    for trial in result.wrong:
        predicted = f", predicted {trial.expected}" if trial.expected else ""
        print_text(
            f"WRONG: {trial.mechanism}, {trial.axis} {number(trial.value, 3)}: reported {trial.outcome}, "
            f"correct {trial.right}{predicted}"
        )
    borders = [
        (b.axis, b.mechanism, number(b.inside, 2), b.before, number(b.outside, 2), b.after)
        for b in result.borders
    ]
    print_table("Borders", ("axis", "mechanism", "up to", "", "from", ""), borders)
    correct = len(result.trials) - len(result.wrong)
    typer.echo(
        f"{correct} of {len(result.trials)} runs ended as the analytic solution predicts, and reported it"
    )
