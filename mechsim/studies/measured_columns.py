"""Headers of measured tables: a unit in brackets, and ± for the standard deviations of another column."""

import re
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from mechsim import units
from mechsim.errors import InputError
from mechsim.numerics.arrays import Array

# before or after the name of a quantity
MARKS = ("±", "+-")
_UNIT = re.compile(r"(.*?)\s*\[([^\]]*)\]\s*")


def columns_in_si(table: Mapping[str, ArrayLike], where: str) -> dict[str, Array]:
    """Return the columns of a table in SI, named without their units.

    Raises:
        InputError: for a unit that is not known, or two columns of one name.
    """
    found: dict[str, Array] = {}
    for header, values in table.items():
        name, factor = column_in_si(header, where)
        if name in found:
            raise InputError(f"{where} has the column {name!r} twice; leave one out")
        found[name] = factor * np.asarray(values, dtype=np.float64)
    return found


def column_in_si(header: str, where: str) -> tuple[str, float]:
    """Return the name in a header as `P.x [mm]`, and the factor that makes its values SI.

    Raises:
        InputError: for a unit that is not known.
    """
    found = _UNIT.fullmatch(header)
    if found is None:
        return header, 1.0
    for unit in ("m", "rad", "m/s", "rad/s", "m/s^2", "rad/s^2", "N", "N m", "s"):
        try:
            return found[1], units.parse(f"1 {found[2]}", unit)
        except InputError:
            continue
    raise InputError(
        f"{where} has the column {header!r}, whose unit is none that is known; write it as [mm] or [deg]"
    )


def deviation_of(name: str) -> str | None:
    """Return the quantity whose standard deviation a column holds; None for other columns."""
    for mark in MARKS:
        if name.startswith(mark) or name.endswith(mark):
            return name.removeprefix(mark).removesuffix(mark).strip()
    return None
