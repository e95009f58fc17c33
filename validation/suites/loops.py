"""Loop tests of other engines with printed values: models/loops.toml and models in models/loops/."""

from collections.abc import Iterator

import mechsim as ms
from validation.suites.case import Case, Clone, Suite
from validation.suites.released import columns, entries, model_of, run_of
from validation.suites.textbooks import printed_row


def cases(_: Clone | None) -> Iterator[Case]:
    for name, entry in entries("loops").items():
        model = model_of(f"loops/{name}")
        if entry["state"] == "equilibrium":
            values = {f"{joint}.q": q for joint, q in ms.dynamics.equilibria(model)[0].q.items()}
        else:
            values = {column: rows[0] for column, rows in columns(run_of(model, 1e-3, 1)).items()}
        rows = [printed_row(answer, values.__getitem__) for answer in entry["values"].split("; ")]
        yield Case(name, tuple(rows), source_fault=entry.get("source_fault", ""))


SUITE = Suite(
    "Other engines: loop tests",
    "",
    "Drake and RigidBodyDynamics.jl. Pinocchio's closed loops are random models.",
    cases,
)
