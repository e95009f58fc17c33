"""Loop tests of other engines with printed values: models/loops.toml and models in models/loops/."""

from collections.abc import Iterator

import mechsim as ms
from validation.suites.case import Case, Clone, Suite, printed_case
from validation.suites.released import columns, entries, model_of, run_of


def cases(_: Clone | None) -> Iterator[Case]:
    for name, entry in entries("loops").items():
        model = model_of(f"loops/{name}")
        if entry["state"] == "equilibrium":
            values = {f"{joint}.q": q for joint, q in ms.dynamics.equilibria(model)[0].q.items()}
        else:
            row, run = -(entry["state"] == "end"), run_of(model, entry["duration"], 1)
            values = {column: rows[row] for column, rows in columns(run).items()}
        yield printed_case(name, entry, values.__getitem__)


SUITE = Suite(
    "Other engines: loop tests",
    "",
    "Drake, RigidBodyDynamics.jl, Multibody.jl. Pinocchio's closed loops are random models;"
    " MBDyn's tests print no values.",
    cases,
)
