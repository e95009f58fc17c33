"""Output in other units than SI: `--units mm`, `--units mm,deg`, `--units file`."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated

import typer

from mechsim import units
from mechsim.analytic.solvers import KinematicSolver
from mechsim.errors import InputError
from mechsim.files import Tabled
from mechsim.numerics.arrays import Array

Units = Annotated[
    str | None,
    typer.Option(
        metavar="UNITS",
        help="Units of lengths and angles in tables, and columns labelled with them: mm, deg, mm,deg, SI, or "
        "file for those that the file declares. JSON is in SI.",
    ),
]


@dataclass(frozen=True, slots=True)
class OutputUnits:
    """Units of lengths and angles in tables; all other quantities are in SI.

    Attributes:
        length: as written.
        angle: as written.
    """

    length: str
    angle: str

    def converted(self, unit: str) -> tuple[float, str]:
        """Return by what values in an SI unit are divided, and the unit that they are then in."""
        unit = unit.replace("s2", "s^2").replace("m2", "m^2")
        base, slash, rest = unit.partition("/")
        own = {"m": self.length, "rad": self.angle}.get(base)
        # a stiffness or an inertia per length is no length
        if own is None or rest not in ("", "s", "s^2"):
            return 1.0, unit
        return units.in_si(1.0, own, "m" if base == "m" else "rad"), own + slash + rest

    def label(self, name: str, unit: str) -> str:
        """Return the head of a column of quantities in an SI unit."""
        return f"{name} [{self.converted(unit)[1] or '1'}]"


SI_UNITS = OutputUnits("m", "rad")


@dataclass(frozen=True, slots=True)
class Labelled:
    """A table in other units, its columns labelled with them.

    Attributes:
        table: in SI.
        columns_in: column -> SI unit.
        output: units of lengths and angles.
    """

    table: Tabled
    columns_in: Mapping[str, str]
    output: OutputUnits

    def columns(self) -> Iterator[tuple[str, Array]]:
        """Yield heads with units, and columns in them."""
        for name, values in self.table.columns():
            unit = self.columns_in.get(name, "")
            yield self.output.label(name, unit), values / self.output.converted(unit)[0]


def output_units(text: str | None, solver: KinematicSolver) -> OutputUnits | None:
    """Return the units that `--units` asks for; None without it.

    Raises:
        InputError: for text that is none of the known words and no units of length and angle.
    """
    if text is None:
        return None
    declared = solver.written
    if text == "file":
        return OutputUnits(declared.length, declared.angle)
    units_of = {"m": "m", "rad": "rad"}
    for item in [] if text.lower() == "si" else text.split(","):
        kind = next((unit for unit in ("m", "rad") if _measures(item.strip(), unit)), None)
        if kind is None:
            raise InputError(
                f"--units {text!r} names {item.strip()!r}, which measures no length and no angle; give mm, "
                "deg, both as mm,deg, SI, or file"
            )
        units_of[kind] = item.strip()
    return OutputUnits(units_of["m"], units_of["rad"])


def _measures(written: str, unit: str) -> bool:
    try:
        return bool(written) and units.in_si(1.0, written, "m" if unit == "m" else "rad") > 0.0
    except InputError:
        return False
