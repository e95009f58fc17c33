"""What `mechsim validate --reference` does: both roads against data of 30 digits."""

from collections.abc import Sequence

import typer

from mechsim.analytic import catalog
from mechsim.cli.output import print_json, progress
from mechsim.cli.verdict_text import print_verdicts
from mechsim.studies.reference import by_reference
from mechsim.subjects import reference_data
from mechsim.subjects.subject import load
from mechsim.verdict.checks import Verdict


def validate_by_reference(models: Sequence[str], as_json: bool, *, verbose: bool) -> bool:
    """Judge the mechanisms named, or all of the reference data, and print it; return whether all are met.

    Raises:
        InputError: for a name of which there are no data, or data that are not what their checksum says.
    """
    where = reference_data.folder()
    tables = [reference_data.read(where, name) for name in models or reference_data.names(where)]
    cases: dict[str, Verdict] = {}
    with progress("validate", len(tables)) as tick:
        for table in tables:
            closed = catalog.make(table.name) if table.name in catalog.DRIVES else None
            cases[table.name] = by_reference(load(str(table.mechanism)), table, closed)
            tick(table.name)
    passed = all(case.passed for case in cases.values())
    if as_json:
        print_json({"passed": passed, "mechanisms": {name: case.as_dict() for name, case in cases.items()}})
        return passed
    print_verdicts(cases, verbose=verbose)
    count = sum(case.passed for case in cases.values())
    typer.echo(f"{count} of {len(cases)} mechanisms agree with the reference data in {where}")
    return passed
