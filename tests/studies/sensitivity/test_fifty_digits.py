"""Derivatives of places, velocities and drive efforts against 50 digits by a method that shares no code.

`derivatives.csv` is made by `python validation/sensitivity/fifty_digits.py --write`, from mechanisms of
`reference/mechanisms` alone, with mpmath: all of the catalogue and some of the gallery, at one instant.
"""

import csv
from itertools import groupby
from pathlib import Path

import pytest
from grids import grid

import mechsim as ms

MECHANISMS = Path(__file__).parents[3] / "reference" / "mechanisms"
with Path(__file__).with_name("derivatives.csv").open(encoding="utf-8") as file:
    ROWS = list(csv.DictReader(file))
KEPT = {name: list(rows) for name, rows in groupby(ROWS, key=lambda row: row["mechanism"])}
# of the largest derivative of its kind by the same dimension; 5e-11 is the most that was found
BOUND = 1e-9


def judged(name, rows, spoil=lambda values: values):
    """Largest error of a mechanism's derivatives, by the largest of their kind by the same dimension."""
    path, at = str(MECHANISMS / f"{name}.toml"), float(rows[0]["at"])
    laws = not ms.load(path).motion_laws.crank
    of = ms.moved(path, t=[at]) if laws else ms.moved(path, angles=[at], speed=20.0)
    drives = {
        f"{word}:{item}": f"drive {item}"
        for word in ("torque", "force")
        for item in of.solver.mechanism.drivers
    }
    drives |= {f"torque:{of.solver.mechanism.drivers[0]}": "torque"} if of.offset else {}
    table = ms.sensitivity(of, [*{drives.get(row["column"], row["column"]) for row in rows}])
    off, size = {}, {}
    for row in rows:
        column = drives.get(row["column"], row["column"])
        kind = row["parameter"], table.units[column]
        exact, own = float(row["derivative"]), float(spoil(table.by[row["parameter"]][column])[0])
        off[kind] = max(off.get(kind, 0.0), abs(own - exact))
        size[kind] = max(size.get(kind, 0.0), abs(exact))
    largest = {unit: max(item for (_, other), item in size.items() if other == unit) for _, unit in size}
    # a dimension that does not count has no derivative to be relative to
    return max(item / max(size[kind], 1e-6 * largest[kind[1]]) for kind, item in off.items())


@pytest.mark.parametrize("name", grid(KEPT, ("four_bar", "rssr", "bennett", "five_bar")))
def test_derivatives_agree_with_50_digits(name):
    assert judged(name, KEPT[name]) <= BOUND


def test_derivatives_a_millionth_off_are_rejected():
    assert judged("slider_crank", KEPT["slider_crank"], lambda values: values * (1.0 + 1e-6)) > BOUND
