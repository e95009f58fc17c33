"""Derivatives of positions, velocities and drive forces against 50 digits by a method without shared code.

`derivatives.csv` is made by `python validation/sensitivity/fifty_digits.py --write`, from mechanisms of
`reference/mechanisms` only, with mpmath: the catalogue and part of the gallery, at one instant.
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
REFERENCE = {name: list(rows) for name, rows in groupby(ROWS, key=lambda row: row["mechanism"])}
# relative to the largest derivative of its kind by the same dimension; measured at most 5e-11
MAX_ERROR = 1e-9


def relative_error(name, rows, spoil=lambda values: values):
    """Largest error of a mechanism's derivatives, relative to the largest of the same kind and dimension."""
    path, instant = str(MECHANISMS / f"{name}.toml"), float(rows[0]["at"])
    laws = not ms.load(path).motion_laws.crank
    moved = ms.moved(path, t=[instant]) if laws else ms.moved(path, angles=[instant], speed=20.0)
    drives = {
        f"{word}:{item}": f"drive {item}"
        for word in ("torque", "force")
        for item in moved.solver.mechanism.drivers
    }
    drives |= {f"torque:{moved.solver.mechanism.drivers[0]}": "torque"} if moved.offset else {}
    table = ms.sensitivity(moved, [*{drives.get(row["column"], row["column"]) for row in rows}])
    errors, scales = {}, {}
    for row in rows:
        column = drives.get(row["column"], row["column"])
        kind = row["parameter"], table.units[column]
        exact, computed = float(row["derivative"]), float(spoil(table.by[row["parameter"]][column])[0])
        errors[kind] = max(errors.get(kind, 0.0), abs(computed - exact))
        scales[kind] = max(scales.get(kind, 0.0), abs(exact))
    largest = {unit: max(item for (_, other), item in scales.items() if other == unit) for _, unit in scales}
    # a dimension without effect has no derivative as a scale
    return max(item / max(scales[kind], 1e-6 * largest[kind[1]]) for kind, item in errors.items())


@pytest.mark.long
@pytest.mark.parametrize("name", grid(REFERENCE, ("four_bar", "bennett", "five_bar")))
def test_derivatives_agree_with_50_digits(name):
    assert relative_error(name, REFERENCE[name]) <= MAX_ERROR


def test_derivatives_off_by_a_millionth_are_rejected():
    assert (
        relative_error("slider_crank", REFERENCE["slider_crank"], lambda values: values * (1.0 + 1e-6))
        > MAX_ERROR
    )
