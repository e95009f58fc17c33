"""Findings in an MJCF file, as text and JSON."""

from collections.abc import Sequence
from typing import Any

import typer

from mechsim.analytic.solvers import KinematicSolver
from mechsim.cli.output import print_table, wrapped
from mechsim.model.finding import Finding
from mechsim.model.motion_laws import CrankProfile, MotionLaws, make_motion_laws
from mechsim.subjects.mjcf_source import MjcfForm


def scene_findings(solver: KinematicSolver, laws: MotionLaws | None = None) -> tuple[Finding, ...] | None:
    """Return the findings in an MJCF file, the most severe first; None for any other mechanism.

    Args:
        solver: the mechanism.
        laws: motion laws of the drivers; None takes its own.
    """
    if not isinstance(solver, MjcfForm) or solver.source is None:
        return None
    # MuJoCo is loaded for MJCF files only
    from mechsim.simulation.findings import findings
    from mechsim.simulation.mjcf import quiet

    with quiet():
        return findings(solver.source, laws or solver.motion_laws)


def motion_law_of_crank(solver: KinematicSolver, motion: CrankProfile) -> MotionLaws | None:
    """Return the motion of the crank of an MJCF file as a motion law; None for any other mechanism."""
    if not isinstance(solver, MjcfForm):
        return None
    return make_motion_laws(solver.mechanism, {solver.mechanism.drivers[0]: motion.state}, motion.duration)


def findings_in_json(findings: Sequence[Finding] | None) -> dict[str, list[dict[str, Any]]]:
    """Return the entry of a JSON object; none where there is no MJCF file."""
    return {} if findings is None else {"findings": [finding.as_dict() for finding in findings]}


def print_findings(findings: Sequence[Finding] | None) -> None:
    """Print findings as a table, or that there are none; nothing where there is no MJCF file."""
    if findings is not None and not findings:
        typer.echo("findings: none")
    rows = [
        (finding.kind, finding.position.removeprefix("line "), finding.advice) for finding in findings or ()
    ]
    print_table("Findings in the file", ("kind", "line", "what; remedy"), rows)


def print_finding_lines(findings: Sequence[Finding] | None) -> None:
    """Print findings before a verdict."""
    for finding in findings or ():
        for line in wrapped(f"{finding.kind}: {finding.one_line}", "", "  "):
            typer.echo(line)
