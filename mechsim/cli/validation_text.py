"""What `mechsim validate` prints: a block for a single mechanism, or a line for each of several."""

from collections.abc import Mapping, Sequence

import typer

from mechsim.cli.against import attribution_lines
from mechsim.cli.scene_findings import tell_findings
from mechsim.cli.terminal import wrapped
from mechsim.cli.verdict_text import (
    METHODS,
    failure_lines,
    headline,
    method_lines,
    print_verdict,
    summary_lines,
)
from mechsim.model.finding import Finding
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion_plane import hinged_normals
from mechsim.simulation.settings import COMPLIANCE
from mechsim.studies.validate import Case

Scenes = Mapping[str, Sequence[Finding] | None]


def print_cases(cases: Mapping[str, Case], scenes: Scenes, speed: str, *, verbose: bool) -> None:
    """Print the results of `mechsim validate`: failures first, with their cause.

    Args:
        cases: results by name.
        scenes: findings in MJCF files by name.
        speed: of the crank, as text.
        verbose: whether all checks are listed.
    """
    single = len(cases) == 1
    for name, case in cases.items():
        tell_findings(scenes[name])
        if verbose or single or not case.passed:
            _print_block(name, case, speed, verbose)
    if single:
        ((_, case),) = cases.items()
        failed = sum(not check.passed for check in case.verdict.checks)
        count = len(case.verdict.checks)
        result = f"{count} checks passed" if case.passed else f"{failed} of {count} checks failed"
        hints = "" if verbose else "; -v lists all, --report DIR writes HTML"
        typer.echo(f"{result} (% = error/tolerance{hints})")
    else:
        _print_summary(cases)
    if posed := sum(case.quick for case in cases.values()):
        mechanisms, them = ("mechanism", "it") if posed == 1 else ("mechanisms", "them")
        typer.echo(f"  ({posed} gallery {mechanisms}: solved poses only; --gallery also steps {them})")


def _print_block(name: str, case: Case, speed: str, verbose: bool) -> None:
    """Print what was compared of a mechanism, and what failed."""
    typer.echo(headline(f"{name}  {_description(case)}", case.passed, case.seconds))
    if not case.passed:
        findings = () if case.formula is None else case.formula.findings
        for line in failure_lines(case.verdict.checks, findings, case.verdict.reason):
            typer.echo(line)
    for line in method_lines(case.verdict.checks, METHODS | {"step": _stepped(case, speed)}):
        typer.echo(line)
    for note in _notes(case):
        for line in wrapped(note):
            typer.echo(line)
    if verbose:
        for line in () if case.formula is None else attribution_lines(case.formula):
            typer.echo(line)
        print_verdict(name, case.verdict)


def _print_summary(cases: Mapping[str, Case]) -> None:
    """Print a line for each mechanism, and how many passed."""
    for line in summary_lines({name: case.verdict for name, case in cases.items()}):
        typer.echo(line)
    passed = sum(case.passed for case in cases.values())
    seconds = sum(case.seconds for case in cases.values())
    typer.echo(f"  {passed} passed, {len(cases) - passed} failed in {seconds:.1f} s   (% = error/tolerance)")


def _description(case: Case) -> str:
    """Return a mechanism in words: planar or spatial, links, degrees of freedom, range of the crank."""
    mechanism = case.drive.mechanism
    facts = [
        "planar" if _is_planar(mechanism) else "spatial",
        f"{len(mechanism.links) + 1} links",
        f"{len(mechanism.drivers)} DOF",
    ]
    if case.drive.motion_laws is None and mechanism.has_crank:
        facts.append("full rotation" if case.drive.crank_range().full else "limited rotation")
    return ", ".join(facts)


def _is_planar(mechanism: Mechanism) -> bool:
    return hinged_normals(mechanism) is not None


def _stepped(case: Case, speed: str) -> str:
    """Return how a stepped run was made."""
    if case.drive.motion_laws is not None:
        speed = "motion laws"
    settings = case.run.settings
    integrator = "" if settings is None else f", {settings.integrator}"
    return f"MuJoCo, {speed}{integrator}, {case.run.steps} steps"


def _notes(case: Case) -> list[str]:
    """Return what else is known of a stepped run."""
    notes: list[str] = []
    if case.compliance not in (None, COMPLIANCE):
        notes.append(
            f"stepped with compliance scale {case.compliance:.2g} of the loops, not {COMPLIANCE:.2g}"
        )
    run = case.run
    if case.published is not None and run.settings is not None and run.timestep is not None:
        own = ", ".join(f"{name} {value}" for name, value in run.settings.rows().items())
        notes.append(f"stepped with mechsim's settings: timestep {1e3 * run.timestep:.3g} ms, {own}")
    return notes
