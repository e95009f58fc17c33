"""Verdicts as tables for people."""

from mechsim.cli.output import print_table
from mechsim.verdict.checks import Verdict, check_table


def print_verdict(on: str, verdict: Verdict, *, reasons: bool = True) -> None:
    """Print the verdict on something, and every check of it as a row, with the reason for its bound."""
    title = f"{on}: {verdict.outcome}" + (f" - {verdict.reason}" if verdict.reason else "")
    columns = slice(None if reasons else -1)
    head, rows = check_table(verdict.checks)
    print_table(title, head[columns], [row[columns] for row in rows])
