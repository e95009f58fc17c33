"""Rigid TestModels of Exudyn, at the end of their tests, against values to which Exudyn converges.

A case is an entry of models/exudyn.toml and a model in models/exudyn/. The values of the tests themselves
have the error of their step, so that Exudyn ran with a quarter and an eighth of it: its method is of order 2.
"""

from collections.abc import Iterator

from validation.published.table import Row
from validation.suites.case import Case, Clone, Suite
from validation.suites.released import columns, entries, model_of, run_of

REASON = "a third of the change by the last halving of Exudyn's step"


def cases(_: Clone | None) -> Iterator[Case]:
    for name, entry in entries("exudyn").items():
        own, rows = columns(run_of(model_of(f"exudyn/{name}"), entry["duration"], 1)), []
        for quantity, (coarse, fine) in entry["values"].items():
            last = (fine - coarse) / 3.0
            rows.append(Row(quantity, float(abs(own[quantity][-1] - fine - last)), abs(last), "", REASON))
        yield Case(name, tuple(rows), note=entry.get("note", ""))


SUITE = Suite(
    "Exudyn: rigid TestModels",
    "",
    "Computed with Exudyn 1.13.6 by files of jgerstmayr/EXUDYN at e44aca1b; four are problems of IFToMM.",
    cases,
)
