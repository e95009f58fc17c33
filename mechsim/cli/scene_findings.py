"""What is wrong with a scene, as `show` tells it and as it stands at the head of a verdict."""

from collections.abc import Sequence
from typing import Any

import typer

from mechsim.analytic.forms import Form
from mechsim.cli.output import print_table
from mechsim.model.crank_profile import CrankProfile
from mechsim.model.finding import Finding
from mechsim.model.motion_laws import MotionLaws, make_motion_laws
from mechsim.subjects.mjcf_source import MjcfForm


def found_in(form: Form, asked: MotionLaws | None = None) -> tuple[Finding, ...] | None:
    """Return what is wrong with the scene of an MJCF file, the gravest first; None of anything else.

    Args:
        form: what moves.
        asked: programs of the drivers; None takes its own.
    """
    if not isinstance(form, MjcfForm) or form.source is None:
        return None
    # what is no scene needs no MuJoCo
    from mechsim.simulation.findings import findings
    from mechsim.simulation.mjcf import quiet

    with quiet():
        return findings(form.source, asked or form.motion_laws)


def of_crank(form: Form, motion: CrankProfile) -> MotionLaws | None:
    """Return the motion of the crank of an MJCF file as a program; None of anything else."""
    if not isinstance(form, MjcfForm):
        return None
    return make_motion_laws(form.mechanism, {form.mechanism.drivers[0]: motion.state}, motion.duration)


def in_json(found: Sequence[Finding] | None) -> dict[str, list[dict[str, Any]]]:
    """Return findings as a JSON object has them; nothing where there is no scene."""
    return {} if found is None else {"findings": [one.as_dict() for one in found]}


def print_findings(found: Sequence[Finding] | None) -> None:
    """Print findings as a table; a line where there are none, nothing where there is no scene."""
    if found is None:
        return
    if not found:
        typer.echo("findings: none")
        return
    rows = [(one.kind, one.place.removeprefix("line "), one.advice) for one in found]
    print_table("Findings in the file", ("kind", "line", "what; remedy"), rows)


def tell_findings(found: Sequence[Finding] | None) -> None:
    """Print findings at the head of a verdict, a line each."""
    for one in found or ():
        typer.echo(f"{one.kind}: {one.told}")
