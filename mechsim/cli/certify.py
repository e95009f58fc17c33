"""Command `mechsim certify`: interval proof of one regular assembly over a range."""

from typing import Annotated

import typer

from mechsim.cli.command import Result, Without, command
from mechsim.cli.options import ModelOptions
from mechsim.cli.output import number, print_table, wrapped
from mechsim.cli.progress import progress
from mechsim.cli.verdict_text import headline
from mechsim.studies.certify import Certificate
from mechsim.studies.certify import certify as certificate_of
from mechsim.studies.certify.certificate import instant_text
from mechsim.studies.sensitivity.tolerances import written_tolerances
from mechsim.units import option


@command
def certify(
    *,
    angles: str | None = option(
        None, "Range of the crank. Default: its whole reachable range.", metavar="START:STOP"
    ),
    within: str | None = option(
        None, "Prove it for all mechanisms within these tolerances: crank=±0.02mm,...", metavar="P=BOUND,..."
    ),
    source: Annotated[ModelOptions, Without("track", "duration", "loops")],
) -> Result:
    """Prove by interval arithmetic that one assembly and no singularity exists over a range.

    Where that fails, singular points are located. Exit code 1 if anything is not certified.

    Examples:
    mechsim certify four_bar
    mechsim certify rssr --angles 10:350deg --within crank=±0.02mm,coupler=0.02mm
    """
    bounds = None if within is None else written_tolerances(within, "--within")
    arguments = source.load_arguments()
    with progress("certify", None) as report:
        proof = certificate_of(source.model, angles, within=bounds, progress=report, **arguments)
    return Result(proof, lambda: _print(proof), proof.certified)


def _print(proof: Certificate) -> None:
    """Print the verdict, the reason and the singular points."""
    typer.echo(headline(proof.name, proof.certified))
    for line in wrapped(proof.summary):
        typer.echo(line)
    rows = [
        (
            point.kind,
            instant_text(point.parameter, proof.unit, 10),
            instant_text(point.width, proof.unit, 2),
        )
        for point in proof.singular
    ]
    print_table("", ("singular point", "at", "±"), rows)
    if proof.segments and not proof.certified:
        remaining = number(1.0 - proof.proven, 2)
        typer.echo(f"  proven on {proof.segments} segments: all but {remaining} of the range")
