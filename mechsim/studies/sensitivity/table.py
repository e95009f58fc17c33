"""Derivatives of quantities by dimensions, over a motion, as one table."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from mechsim.analytic.derivatives import Dimension
from mechsim.errors import AssemblyError, InputError, MissingToolError
from mechsim.model.display import short_repr
from mechsim.numerics.arrays import Array
from mechsim.studies.sensitivity.moved_family import MovedFamily, Slopes
from mechsim.studies.sensitivity.quantities import unit_of
from mechsim.subjects.toml_source import suggestion

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset

# the word for every dimension
ALL = "all"


@dataclass(frozen=True)
class Sensitivity:
    """Quantities of a mechanism and their derivatives by dimensions, over a motion.

    Attributes:
        moved: the mechanism, as it was moved.
        values: quantity -> (n,), in SI.
        by: dimension -> quantity -> derivative at the same position of the drivers, (n,), in SI per SI unit.
        units: quantity -> its SI unit.
        left_out: dimension -> why it has no derivative, of those that only "all" had asked for.
    """

    moved: MovedFamily
    values: Mapping[str, Array]
    by: Mapping[str, Mapping[str, Array]]
    units: Mapping[str, str]
    left_out: Mapping[str, str]

    __repr__ = short_repr

    def __len__(self) -> int:
        return len(self.moved.angles)

    @property
    def name(self) -> str:
        """The mechanism's."""
        return self.moved.family.name

    @property
    def dimensions(self) -> dict[str, Dimension]:
        """The dimensions, by name."""
        return {name: self.moved.family.dimensions[name] for name in self.by}

    def of(self, quantity: str) -> dict[str, Array]:
        """Return the derivatives of a quantity: dimension -> (n,)."""
        return {name: own[quantity] for name, own in self.by.items()}

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield the crank angle or the time, then QUANTITY/DIMENSION for each of both."""
        yield self.moved.over
        for quantity in self.values:
            for name, values in self.of(quantity).items():
                yield f"{quantity}/{name}", values

    def unit(self, quantity: str, dimension: str) -> str:
        """Return the unit of a derivative."""
        return per(self.units[quantity], self.dimensions[dimension].unit)

    def to_pandas(self) -> "DataFrame":
        """Return the columns as a table, a row an instant.

        Raises:
            MissingToolError: where pandas is not installed.
        """
        return library("pandas").DataFrame(dict(self.columns()))

    def to_xarray(self) -> "Dataset":
        """Return quantities over instants, and derivatives "QUANTITY/" over instants and dimensions.

        Raises:
            MissingToolError: where xarray is not installed.
        """
        over, at = self.moved.over
        found: dict[str, Any] = {}
        for quantity, values in self.values.items():
            unit = self.units[quantity]
            found[quantity] = (over, values, {"units": unit})
            rows = np.array([*self.of(quantity).values()])
            about = {"long_name": f"derivative of {quantity}", "units": f"{unit} per unit of the dimension"}
            found[f"{quantity}/"] = (("dimension", over), rows, about)
        coordinates = {
            over: (over, at, {"units": "rad" if over == "angle" else "s"}),
            "dimension": [*self.by],
            "unit": ("dimension", [one.unit for one in self.dimensions.values()]),
            "value": ("dimension", [one.value for one in self.dimensions.values()]),
        }
        return library("xarray").Dataset(found, coordinates, {"mechanism": self.name})


def per(unit: str, by: str) -> str:
    """Return the unit of a derivative."""
    if unit == by:
        return "1"
    return unit if by == "1" else f"{'1' if unit == '1' else unit}/{by}"


def library(name: str) -> Any:
    """Return a library that is not always there.

    Raises:
        MissingToolError: where it is not.
    """
    try:
        return import_module(name)
    except ImportError:
        raise MissingToolError(f"{name} is not installed; pip install 'mechsim[tables]' brings it") from None


def dimensions_asked(moved: MovedFamily, to: str | Sequence[str]) -> list[str]:
    """Return names of dimensions, whole places by their parts; the word "all" stands for every one.

    Raises:
        InputError: for an unknown one.
    """
    known = moved.family.dimensions
    if to == ALL or list(to) == [ALL]:
        return list(moved.family.usual or known)
    found: dict[str, None] = {}
    for name in (to,) if isinstance(to, str) else to:
        parts = [one for one in known if one == name or one.startswith(f"{name}.")]
        if name not in known and not parts:
            shown = moved.family.usual or known
            raise InputError(f"{moved.family.name} has no dimension {name!r}{suggestion(name, shown)}")
        found |= dict.fromkeys([name] if name in known else parts)
    return list(found)


def derivative_table(moved: MovedFamily, of: Sequence[str], to: str | Sequence[str] = ALL) -> Sensitivity:
    """Return quantities of a mechanism and their exact derivatives by dimensions.

    Args:
        moved: the mechanism, and how it moves.
        of: quantities (see `columns_of`).
        to: dimensions; "all" leaves those out that would tear loops open.

    Raises:
        InputError: for an unknown quantity or dimension.
        AssemblyError: where the loops do not close, or two assemblies meet.
    """
    columns, names = moved.quantities(of), dimensions_asked(moved, to)
    left_out: dict[str, str] = {}
    try:
        found = moved.slopes(columns, names)
    except AssemblyError:
        if to != ALL and list(to) != [ALL]:
            raise
        found = moved.slopes(columns, [])
        for name in names:
            try:
                one = moved.slopes(columns, [name])
            except AssemblyError as error:
                left_out[name] = str(error)
                continue
            found = Slopes(found.values, {**found.by, **one.by})
    units = {one: unit_of(one, moved.form.mechanism) for one in columns}
    return Sensitivity(moved, found.values, found.by, units, left_out)
