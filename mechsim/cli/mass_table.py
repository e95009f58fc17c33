"""The masses that a command uses: one line, with -v a table."""

from collections.abc import Sequence
from typing import Annotated

import typer

from mechsim.cli.output import print_table
from mechsim.model.masses import LinkMass, summary

Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="List the masses of the links, too.")]


def print_masses(masses: Sequence[LinkMass], verbose: bool | None = None, of: str = "") -> None:
    """Print the masses and where they come from.

    Args:
        masses: of the links; nothing is printed where there are none.
        verbose: whether they are listed; None where a command has no -v.
        of: what has these masses, where a command computes with several.
    """
    if not masses:
        return
    if not verbose:
        hint = "; -v lists them" if verbose is not None and any(one.source == "rod" for one in masses) else ""
        typer.echo(summary(masses).replace("masses", f"masses {of}".rstrip(), 1) + hint)
        return
    rows = [(one.link, f"{one.mass:.6g}", "kg", one.text) for one in masses]
    print_table("masses", ("link", "mass", "unit", "source"), rows)
