"""Measured motion: a table with columns named like our quantities, some with standard deviations."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mechsim import files, units
from mechsim.errors import InputError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.numerics.arrays import HUGE, Array

if TYPE_CHECKING:
    from mechsim.studies.sensitivity.moved_family import MovedFamily

# prefixes or suffixes of columns with standard deviations
DEVIATION_SIGNS = ("±", "+-")


@dataclass(frozen=True)
class TableColumn:
    """One column of a table, in SI.

    Attributes:
        values: (n,).
        uncertainty: standard deviations, (n,); None without any.
    """

    values: Array
    uncertainty: Array | None = None


def read_measured(path: str) -> dict[str, Array]:
    """Return the columns of a .csv or .npz file (`files.read`), or the joint states of an .mcap file."""
    if not path.lower().endswith(".mcap"):
        return files.read(path)
    from mechsim.studies.joint_log import read_log

    return read_log(Path(path))


def table_columns(table: Mapping[str, ArrayLike], where: str) -> dict[str, TableColumn]:
    """Return the columns of a table by name, in SI, each with its standard deviations.

    A header may contain a unit, as `P.x [mm]`; a column `P.x ±`, or `± P.x`, contains standard deviations.

    Raises:
        InputError: for an unknown unit, two columns of one name, numbers that are not finite, standard
            deviations without a column, or standard deviations that are not above 0.
    """
    columns = units.table_in_si(table, where)
    for name, values in columns.items():
        _require_rows(values, np.abs(values) <= HUGE, name, where, "remove the row")
    result = {name: TableColumn(values) for name, values in columns.items() if deviation_of(name) is None}
    for name, values in columns.items():
        quantity_name = deviation_of(name)
        if quantity_name is None:
            continue
        if quantity_name not in result:
            raise InputError(
                f"{where}: column {name} is the standard deviation of {quantity_name}, but there is no "
                f"column {quantity_name}; there are {', '.join(result)}"
            )
        _require_rows(values, values > 0.0, name, where, "give it above 0")
        result[quantity_name] = TableColumn(result[quantity_name].values, values)
    return result


def _require_rows(values: Array, valid: NDArray[np.bool_], name: str, where: str, remedy: str) -> None:
    """Reject a column (n,) with an invalid value; the message names the first one."""
    if not valid.all():
        row = int(np.argmin(valid))
        problem = f"{values[row]:g}" if np.isfinite(values[row]) else "no finite number"
        raise InputError(f"{where}: column {name} is {problem} in row {row + 1}; {remedy}")


def deviation_of(name: str) -> str | None:
    """Return the quantity of a column of standard deviations; None for other columns."""
    for sign in DEVIATION_SIGNS:
        if name.startswith(sign) or name.endswith(sign):
            return name.removeprefix(sign).removesuffix(sign).strip()
    return None


# largest range of crank angles in [rad]; the solver follows the path over all of it
MAX_RANGE = 2e3 * np.pi


@dataclass(frozen=True)
class MeasuredMotion:
    """Measured quantities at n instants.

    Attributes:
        over: crank angle in [rad], or t in [s] under motion laws, as in the table, (n,).
        angles: path parameters, (n,) in [rad].
        values: quantity -> (n,), in SI.
        deviations: quantity -> standard deviations, (n,), if known.
    """

    over: Array
    angles: Array
    values: Mapping[str, Array]
    deviations: Mapping[str, Array]

    @property
    def count(self) -> int:
        """Number of measured values."""
        return len(self.angles) * len(self.values)


def measured_of(
    table: Mapping[str, ArrayLike], solver: KinematicSolver, where: str = "the table"
) -> MeasuredMotion:
    """Return the measured motion of a table: angle (or t under motion laws), quantities, and ± columns.

    A header may contain a unit, as `P.x [mm]`; the default is SI.

    Raises:
        InputError: without angle or t, for numbers that are not finite, or a ± column without its quantity.
    """
    columns, motion_laws = table_columns(table, where), solver.motion_laws
    over = motion_laws.axis
    if motion_laws.crank and over not in columns and f"{solver.mechanism.drivers[0]}.q" in columns:
        columns[over] = columns.pop(f"{solver.mechanism.drivers[0]}.q")
    if over not in columns:
        unit = "crank angles in rad" if over == "angle" else "times in s"
        raise InputError(f"{where} has no column {over} ({unit}); it has {', '.join(columns) or 'none'}")
    instants = columns[over].values
    # instants and prescribed motions count as exact
    for name in (over, "angle", "t", "time", "speed", "acceleration", *solver.mechanism.drivers):
        if name in columns and columns.pop(name).uncertainty is not None:
            raise InputError(f"{where}: column {name} counts as exact; leave out its standard deviation")
    values = {name: column.values for name, column in columns.items()}
    deviations = {
        name: column.uncertainty for name, column in columns.items() if column.uncertainty is not None
    }
    if not values:
        raise InputError(f"{where} contains no measured quantity; add columns as P3.x or rocker.q")
    angles = motion_laws.parameter(instants)
    if len(angles) and float(np.ptp(angles)) > MAX_RANGE:
        turns = float(np.ptp(angles)) / (2.0 * np.pi)
        raise InputError(
            f"{where}: column {over} covers {turns:.4g} turns; the limit is {MAX_RANGE / (2.0 * np.pi):g}"
        )
    return MeasuredMotion(instants, angles, values, deviations)


def single(table: Mapping[str, Array], moved: "MovedFamily") -> dict[str, str]:
    """Return the quantity of each column of a table: name in the table -> our name.

    Names of forces in `reference/` are accepted too: torque:J of a crank or of a driver, and force:J of a
    prismatic driver.

    Raises:
        InputError: for a column that is no quantity, or several quantities.
    """
    names: dict[str, str] = {}
    straight = {f"force:{name}": f"drive {name}" for name in moved.solver.mechanism.straight}
    for name in table:
        columns = moved.quantities([straight.get(name, name)])
        if len(columns) != 1:
            raise InputError(f"column {name} is not a single quantity; name columns as P3.x or rocker.q")
        names[name] = columns[0]
    return names
