"""Solve the suites of others: python -m validation.suites [SUITE ...] [--source FOLDER] [--json].

FOLDER holds git clones by their names, such as FOLDER/chrono. Without it, the figures kept here are compared.
If their clones are there, the suites' sections of docs/explanation/outside_evidence.md are written. Exit code
1 if a difference is not explained or mechsim is wrong.
"""

import argparse
import json
import sys
from importlib import import_module
from pathlib import Path

from validation.suites import page
from validation.suites.case import Case, Clone, Suite

ENGINES = ("chrono", "exudyn", "loops", "modelica", "menagerie", "kamino", "gepetto")
NAMES = (*ENGINES, "pmks", "textbooks", "squeezer")
SUITES: dict[str, Suite] = {name: import_module(f"validation.suites.{name}").SUITE for name in NAMES}
WRONG = ("mechsim wrong", "unexplained")


def clone_of(suite: Suite, folder: Path | None) -> Clone | None:
    path = folder / suite.repository.split("/")[1] if folder and suite.repository else None
    return Clone(path) if path and path.is_dir() else None


def show(suite: Suite, cases: list[Case]) -> None:
    print(suite.title if cases else f"{suite.title}: not compared, needs --source")
    for case in cases:
        print(f"  {case.name}: {case.outcome} {case.remark}")
        for row in (*case.rows, *case.evidence):
            relation = "<=" if row.passed else "> "
            print(f"    {row.quantity:<28} {row.error:9.2e} {relation} {row.tolerance:8.1e} {row.unit}")
            print(f"      {row.reason}")


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("suites", nargs="*", metavar="SUITE", help=", ".join(SUITES))
    parser.add_argument("--source", type=Path, help="folder of the clones")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args(words)
    if unknown := {*options.suites} - {*SUITES}:
        parser.error(f"there is no suite {', '.join(sorted(unknown))}; give {', '.join(SUITES)}")
    chosen = {name: SUITES[name] for name in options.suites or SUITES}
    clones = {name: clone_of(suite, options.source) for name, suite in chosen.items()}
    results = {name: list(suite.cases(clones[name])) for name, suite in chosen.items()}
    if options.json:
        records = {name: [page.record(case) for case in cases] for name, cases in results.items()}
        print(json.dumps(records, indent=1))
    else:
        for name, cases in results.items():
            show(chosen[name], cases)
    if options.source and all(clones[name] for name, suite in chosen.items() if suite.repository):
        page.write(SUITES, clones, results)
    return int(any(case.outcome in WRONG for cases in results.values() for case in cases))


if __name__ == "__main__":
    sys.exit(main())
