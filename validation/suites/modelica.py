"""Modelica's MultiBody examples against the reference results of the library, which Dymola computed.

A case is an entry of models/modelica.toml and a model in models/modelica/. Gravity is 9.80665 m/s2 along -y,
the density of boxes and cylinders 7700 kg/m3. Links have the axes of Modelica's frames.
"""

import csv
from collections.abc import Iterator, Mapping

import numpy as np

from mechsim.errors import InputError
from mechsim.numerics.arrays import Array
from validation.published.table import Row
from validation.suites.case import Case, Clone, Suite, kept, rejected
from validation.suites.released import columns, entries, model_of, run_of

ROOTS = {"Examples": "Modelica/Mechanics/MultiBody/Examples", "ModelicaTest": "ModelicaTest/MultiBody"}
# of the range of a signal: the tube in which the library's own comparison (CSV Compare) accepts results
TUBE = 2e-3
# smallest range of a signal: below it is the integration error of a constant, at Dymola's tolerance of 1e-6
SMALLEST = 1e-3
# of instants in [s]
ROUNDING = 1e-9
REASON = "of the range of a signal: the tube of the library's own comparison"


def table(clone: Clone | None, name: str) -> dict[str, Array]:
    """Return the columns of a result."""
    if clone is None:
        rows = [row[1:] for row in kept("modelica") if row[0] == name]
    else:
        library, _, path = name.partition("/")
        text = clone.read(f"{ROOTS[library]}/{path}/{path.rpartition('/')[2]}.csv")
        rows = list(csv.reader(text.splitlines()))
    return dict(zip(rows[0], np.array(rows[1:], float).T, strict=True))


def pairs(signals: Mapping[str, str], reference: Mapping[str, Array]) -> Iterator[tuple[str, str]]:
    """Yield columns of the reference and of ours; a vector stands for its three components."""
    for theirs, ours in signals.items():
        if theirs in reference:
            yield theirs, ours
        else:
            yield from ((f"{theirs}[{i}]", ours + axis) for i, axis in enumerate("xyz", 1))


def path_of(name: str) -> str:
    return "modelica/" + name.replace("/", ".")


def compared(name: str, clone: Clone | None) -> Case:
    entry = entries("modelica")[name]
    if "rejected" in entry and "says" not in entry:
        return Case(name, rejected=entry["rejected"])
    try:
        model = model_of(path_of(name))
    except InputError as error:
        return rejected(name, error, entry)
    reference = table(clone, name)
    run = run_of(model, float(reference["time"][-1]))
    own = columns(run)
    # all instants of ours that the table has
    which = np.searchsorted(reference["time"], run.time - ROUNDING)
    shared = np.abs(reference["time"][which] - run.time) < ROUNDING
    rows = []
    for signal, ours in pairs(entry["signals"], reference):
        theirs = reference[signal]
        error = np.abs(own[ours] - theirs[which])[shared].max() / max(np.ptp(theirs), SMALLEST)
        rows.append(Row(signal, float(error), TUBE, "", REASON))
    exact, evidence = entry.get("exact"), ()
    if exact:
        ours = own[dict(pairs(entry["signals"], reference))[exact["signal"]]]
        error = np.interp(exact["at"], run.time, ours) - exact["value"]
        evidence = (Row(exact["signal"], float(abs(error)), exact["tolerance"], "", "of a third method"),)
    return Case(name, tuple(rows), "", entry.get("source_fault", ""), evidence)


def cases(clone: Clone | None) -> Iterator[Case]:
    for name, entry in entries("modelica").items():
        if clone or not entry.get("slow"):
            yield compared(name, clone)


SUITE = Suite(
    "Modelica: MultiBody examples",
    "modelica/MAP-LIB_ReferenceResults",
    "Dymola's results at a tolerance of 1e-6, 501 instants.",
    cases,
)
