"""Text on a mechanism that needs no run of it: its type, and the findings in its file."""

from collections.abc import Sequence
from contextlib import suppress

from mechsim.cli.output import print_table, print_text
from mechsim.errors import SingularStartError, several
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.finding import Finding
from mechsim.mechanism.motion_plane import hinged_normals


def kind(solver: KinematicSolver, dofs: int | None = None) -> str:
    """Return the type of a mechanism: planar or spatial, links, degrees of freedom, range of the crank.

    Args:
        solver: the mechanism.
        dofs: its degrees of freedom, if they differ from the number of drivers.
    """
    mechanism = solver.mechanism
    drivers = len(mechanism.drivers)
    words = [
        "spatial" if hinged_normals(mechanism) is None else "planar",
        several(sum(link.is_body for link in mechanism.links) + 1, "link"),
        f"{drivers if dofs is None else dofs} DOF",
    ]
    if dofs not in (None, drivers):
        words.append(several(drivers, "driver"))
    elif solver.motion_laws.crank and mechanism.has_crank:
        with suppress(SingularStartError):
            words.append("full rotation" if solver.crank_range().full else "limited rotation")
    return ", ".join(words)


def findings_in_json(findings: Sequence[Finding] | None) -> dict[str, Sequence[Finding]]:
    """Return the entry of a JSON object; empty without an MJCF file."""
    return {} if findings is None else {"findings": findings}


def print_findings(findings: Sequence[Finding] | None) -> None:
    """Print findings as a table; print nothing without any."""
    rows = [
        (finding.kind, finding.position.removeprefix("line "), finding.advice) for finding in findings or ()
    ]
    print_table("Findings in the file", ("kind", "line", "what; remedy"), rows)


def print_finding_lines(findings: Sequence[Finding] | None) -> None:
    """Print findings before a verdict."""
    for finding in findings or ():
        print_text(f"{finding.kind}: {finding.one_line}")
