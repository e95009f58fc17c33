"""The rules of `mechsim check`: identifier, severity, title and reason of each kind of finding."""

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

from mechsim.mechanism.finding import HARMLESS, Finding, Severity


@dataclass(frozen=True, slots=True)
class Rule:
    """A rule of the linter.

    Attributes:
        code: identifier, such as MS101.
        kind: kind of the findings that the rule reports.
        severity: "error" if a run becomes wrong, "warning" if it is distorted, "note" for information.
        title: a few words.
        reason: the cause, in one or two sentences.
        target: value with which a finding is gone; None where no single value is right.
    """

    code: str
    kind: str
    severity: Severity
    title: str
    reason: str
    target: float | None = None


RULES = tuple(
    Rule(code, **row)
    for code, row in tomllib.loads(Path(__file__).with_name("rules.toml").read_text(encoding="utf-8")).items()
)
BY_KIND = {rule.kind: rule for rule in RULES}


def with_severity(finding: Finding) -> Finding:
    """Return a finding with code, target and severity of its rule; a harmless one is a note."""
    rule = BY_KIND[finding.kind]
    severity = "note" if finding.remedy == HARMLESS else rule.severity
    return replace(finding, severity=severity, rule=rule.code, target=rule.target)
