"""A quantity of a mechanism: a function of columns of motions and forces. `model.quantities` reads names."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal

import numpy as np

from mechsim.mechanism.links import AXES
from mechsim.mechanism.motion import Motion
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.jets import change_of, stepped

# rows and columns of a rotation matrix
ELEMENTS = tuple(product(range(3), repeat=2))
TRANSMISSION = "transmission"
Source = Literal["point", "joint", "link", "force", "formula"]


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a motion or of its forces.

    Attributes:
        name: as in `Motion.columns`, `ForceRecord.columns` or `link_column`.
        unit: in SI.
        source: record that contains it: points, joint coordinates or links of motions, forces, or the
            analytic inverse dynamics only ("formula").
        subject: point, joint coordinate, link, or the column itself.
        order: time derivatives: 0 for positions and forces, 1 for velocities, 2 for accelerations.
    """

    name: str
    unit: str
    source: Source
    subject: str
    order: int = 0


Function = Callable[[Sequence[Array]], Array]


@dataclass(frozen=True, slots=True)
class Quantity:
    """A quantity of a mechanism over a motion.

    Attributes:
        name: as written.
        kind: a row of `KINDS`, or "effort" for a column of forces and energies.
        subject: point, joint coordinate, joint or drive; of derived quantities, the text after the colon.
        unit: in SI.
        columns: columns from which it is computed.
        axes: ground axes of its components, such as "xyz" or "x"; empty for a scalar.
        function: columns -> the quantity, also with complex steps; None if the columns are its components.
    """

    name: str
    kind: str
    subject: str
    unit: str
    columns: tuple[Column, ...]
    axes: str = ""
    function: Function | None = None

    @property
    def angle(self) -> bool:
        """Whether its values are angles modulo a revolution."""
        return self.unit == "rad" and self.kind in ("joint", "angle")

    @property
    def loaded(self) -> bool:
        """Whether it needs masses and forces."""
        return self.uses("force", "formula") and self.kind != TRANSMISSION

    @property
    def order(self) -> int:
        """Highest time derivative in it: 0 for positions and forces, 2 for accelerations."""
        return max((column.order for column in self.columns), default=0)

    def uses(self, *sources: Source) -> bool:
        """Whether it needs columns of one of these sources."""
        return any(column.source in sources for column in self.columns)

    def subjects(self, source: Source) -> list[str]:
        """Return the points, joint coordinates or links of a source that it needs."""
        return [column.subject for column in self.columns if column.source == source]

    def components(self, columns: Mapping[str, Array]) -> list[Array]:
        """Return its components, (...) each, from columns (...)."""
        values = [np.asarray(columns[column.name]) for column in self.columns]
        return values if self.function is None else [self.function(values)]

    def number(self, columns: Mapping[str, Array]) -> Array:
        """Return it as a scalar at each instant, (...): the length of a vector."""
        values = self.components(columns)
        return values[0] if len(values) == 1 else np.sqrt(sum(value**2 for value in values))

    def changes(self, columns: Mapping[str, Array], by: Mapping[str, Array]) -> list[Array]:
        """Return the exact derivatives of its components from those of the columns, (...) each."""
        if self.function is None:
            return [by[column.name] for column in self.columns]
        stepped_columns = {
            column.name: stepped(columns[column.name], by[column.name]) for column in self.columns
        }
        return [change_of(value) for value in self.components(stepped_columns)]

    def scalars(self) -> "tuple[Quantity, ...]":
        """Return each component as a quantity, with the name of its column."""
        if self.function is not None:
            return (self,)
        axes = self.axes or " " * len(self.columns)
        return tuple(
            replace(self, name=column.name, unit=column.unit, columns=(column,), axes=axis.strip())
            for column, axis in zip(self.columns, axes, strict=True)
        )

    def select(self, vectors: Array) -> Array:
        """Return the components of vectors (n, 3) along its axes, (n, k)."""
        return vectors[:, [AXES.index(axis) for axis in self.axes]]

    def along(self, axes: str) -> "Quantity":
        """Return the components along some of its axes as a quantity."""
        return replace(self, axes=axes, columns=tuple(self.columns[self.axes.index(axis)] for axis in axes))


def record_columns(record: Any, quantities: Iterable[Quantity]) -> dict[str, Array]:
    """Return the columns of a motion or of forces, and the rotations of links, that quantities need."""
    columns = dict(record.columns())
    links = {link for quantity in quantities for link in quantity.subjects("link")}
    for link in links if isinstance(record, Motion) else ():
        columns |= {link_column(link, i, j): record.links[link].rotation[:, i, j] for i, j in ELEMENTS}
    return columns


def link_column(link: str, i: int, j: int) -> str:
    """Return the name of an element of a link's rotation matrix."""
    return f"rotation of {link}.{i}{j}"


def unwrapped(angles: Array) -> Array:
    """Return angles (..., n) without jumps of whole revolutions between instants."""
    steps = np.diff(np.real(angles), axis=-1)
    revolutions = np.round(steps / REVOLUTION)
    if not revolutions.any():
        return angles
    out = angles.copy()
    out[..., 1:] -= REVOLUTION * np.cumsum(revolutions, axis=-1)
    return out
