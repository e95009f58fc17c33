"""Command `mechsim check`: a linter for closed-loop MuJoCo models."""

import json
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from mechsim._version import __version__
from mechsim.cli.command import Result, Stated, command, output_file
from mechsim.cli.output import in_colour, print_json, wrapped
from mechsim.errors import InputError, several
from mechsim.files import write_content
from mechsim.mechanism.finding import HARMLESS, Finding
from mechsim.simulation.findings.rule_table import RULES
from mechsim.studies.check import check_each, fixed_copy
from mechsim.units import option

FORMATS = ("text", "json", "github", "sarif")
COLOURS = {"error": "red", "warning": "yellow", "note": "blue"}
SARIF_SCHEMA = "https://json.schemastore.org/sarif-2.1.0.json"
PAGE = "docs/reference/check.md"


@command
def check_files(
    models: Annotated[list[str], typer.Argument(metavar="FILE...", help="MJCF or URDF files.")],
    *,
    stated: Stated,
    select: str | None = option(
        None, "Apply only these rules; MS1 selects all that begin with it.", metavar="RULE,..."
    ),
    ignore: str | None = option(None, "Omit these rules.", metavar="RULE,..."),
    fix: Annotated[
        str | None, output_file("Write a repaired copy of the file.", ".xml", name="--fix", metavar="OUT")
    ] = None,
    output_format: str = option("text", "Format of the findings.", metavar="text|json|github|sarif"),
    loops: str | None = option(None, "Loop closures of a URDF file, in YAML.", metavar="FILE"),
) -> Result:
    """Check closed-loop MJCF and URDF files for common mistakes. An error ends with exit code 1.

    Examples:
    mechsim check gripper.xml ankle.xml --ignore MS111
    mechsim check gripper.xml --fix repaired.xml
    """
    stated.exclude(["output_format"], "with --json", "as_json" in stated.options)
    if output_format not in FORMATS:
        raise InputError(f"there is no output format {output_format!r}; choose from {', '.join(FORMATS)}")
    for path, use in ((fix, "--fix repairs one file"), (loops, "--loops closes the loops of one file")):
        if path is not None and len(models) != 1:
            raise InputError(f"{use}, and there are {len(models)}; check them one by one")
    codes = [text.split(",") if text else [] for text in (select, ignore)]
    violations = check_each(models, select=codes[0], ignore=codes[1], loops=loops)
    errors = sum(violation.severity == "error" for violation in violations)
    data: dict[str, Any] = {"files": len(models), "errors": errors, "findings": violations}
    repaired: list[str] = []
    if fix is not None:
        copy, repaired = fixed_copy(models[0], Path(fix), violations)
        write_content(fix, copy)
        data["fixed"] = fix

    def text() -> None:
        _print(violations, output_format, data)
        if fix is not None:
            typer.echo(
                f"wrote {fix}, repaired: {', '.join(repaired) or 'nothing'}", err=output_format != "text"
            )

    return Result(data, text, errors == 0)


def _print(violations: Sequence[Finding], output_format: str, data: dict[str, Any]) -> None:
    if output_format == "json":
        print_json(data)
    elif output_format == "sarif":
        typer.echo(json.dumps(_sarif(violations), indent=2))
    elif output_format == "github":
        for violation in violations:
            typer.echo(_github(violation))
    else:
        for violation in violations:
            position = violation.file if violation.line is None else f"{violation.file}:{violation.line}"
            head = " ".join(f"{position}: {violation.rule} {violation.severity}: {violation.message}".split())
            # editors and grep read one finding per line
            in_terminal = sys.stdout.isatty()
            lines = wrapped(head, "", "  ") if in_terminal else [head]
            typer.echo("\n".join([in_colour(lines[0], COLOURS[violation.severity]), *lines[1:]]))
            if _remedy(violation):
                indented = f"    {_remedy(violation)}"
                typer.echo("\n".join(wrapped(indented, "", "    ")) if in_terminal else indented)
        counts = Counter(violation.severity for violation in violations)
        total = ", ".join(several(counts[severity], severity) for severity in COLOURS)
        typer.echo(f"{several(data['files'], 'file')}: {total}")


def _remedy(violation: Finding) -> str:
    """Return the remedy; empty for a harmless finding."""
    return "" if violation.remedy == HARMLESS else violation.remedy


def _message(violation: Finding) -> str:
    """Return the message and the remedy."""
    return f"{violation.message}; {_remedy(violation)}".removesuffix("; ")


def _github(violation: Finding) -> str:
    """Return a workflow command of GitHub Actions."""
    kind = "notice" if violation.severity == "note" else violation.severity
    line = "" if violation.line is None else f",line={violation.line}"
    name = _escaped(violation.file).replace(":", "%3A").replace(",", "%2C")
    return f"::{kind} file={name}{line},title={violation.rule}::{_escaped(_message(violation))}"


def _escaped(text: str) -> str:
    """Return text as GitHub's runner reads it in a workflow command; a line end would start another command.

    Source: actions/toolkit, packages/core/src/command.ts, escapeData; escapeProperty also replaces : and , .
    """
    return text.replace("%", "%25").replace("\r", "%0D").replace("\n", "%0A")


def _sarif(violations: Sequence[Finding]) -> dict[str, Any]:
    """Return findings in the Static Analysis Results Interchange Format, version 2.1.0 (OASIS)."""
    rules = [
        {
            "id": rule.code,
            "name": rule.kind,
            "shortDescription": {"text": rule.title},
            "fullDescription": {"text": rule.reason},
            "helpUri": f"{PAGE}#{rule.code.lower()}",
            "defaultConfiguration": {"level": rule.severity},
        }
        for rule in RULES
    ]
    results = [
        {
            "ruleId": violation.rule,
            "level": violation.severity,
            "message": {"text": _message(violation)},
            "locations": [
                {
                    "physicalLocation": {
                        "artifactLocation": {"uri": violation.file},
                        "region": {"startLine": violation.line or 1},
                    }
                }
            ],
        }
        for violation in violations
    ]
    driver = {"name": "mechsim", "version": __version__, "rules": rules}
    runs = [{"tool": {"driver": driver}, "results": results}]
    return {"$schema": SARIF_SCHEMA, "version": "2.1.0", "runs": runs}
