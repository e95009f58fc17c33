"""A table of measured or published values as claims: columns named like ours, each perhaps with a ±."""

import csv
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mechsim.analytic.forms import Form
from mechsim.analytic.loops.loop_form import LoopForm
from mechsim.errors import InputError
from mechsim.model.mechanism import Mechanism
from mechsim.model.motion_laws import MotionLaws, State, make_motion_laws, tabled
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.claim import Claim
from mechsim.studies.agreement.comparand import Comparand
from mechsim.studies.agreement.named_quantities import AXES, NamedQuantity, Names, nearest
from mechsim.studies.measured_columns import column_in_si, deviation_of

CLOCKS = ("t", "time")
LARGEST = 200_000_000


@dataclass(frozen=True)
class Column:
    """One column of a table, in SI.

    Attributes:
        values: (n,).
        uncertainty: standard deviations, (n,); None where the table has none.
    """

    values: Array
    uncertainty: Array | None = None


def read_table(path: str) -> dict[str, Column]:
    """Return the columns of a .csv file: name -> values in SI.

    A header may name a unit, as `P.x [mm]`; a column `P.x ±`, or `± P.x`, holds standard deviations of P.x.

    Raises:
        InputError: for a file that holds no such table; names the line and the column.
    """
    heads, rows = _rows(path)
    found: dict[str, Array] = {}
    for i, head in enumerate(heads):
        name, factor = column_in_si(head, path)
        if name in found:
            raise InputError(f"{path} has the column {name!r} twice; leave one out")
        found[name] = factor * np.array([row[i] for row in rows])
    known = {name: values for name, values in found.items() if deviation_of(name) is None}
    deviations: dict[str, Array] = {}
    for name, values in found.items():
        of = deviation_of(name)
        if of is not None:
            deviations[of] = _positive(path, of, values)
    for name in deviations:
        if name not in known:
            raise InputError(
                f"{path} has an uncertainty of {name!r}, but no column of it{nearest(name, known)}"
            )
    return {name: Column(values, deviations.get(name)) for name, values in known.items()}


def _positive(path: str, name: str, deviations: Array) -> Array:
    positive = deviations > 0.0
    if not positive.all():
        row = int(np.argmin(positive))
        raise InputError(
            f"the standard deviation of {name} in {path} is {deviations[row]:g} in row {row + 2}; "
            "give it above 0"
        )
    return deviations


def _rows(path: str) -> tuple[list[str], list[list[float]]]:
    try:
        if Path(path).stat().st_size > LARGEST:
            raise InputError(f"{path} is larger than {LARGEST:,} bytes; give a shorter table")
        with open(path, encoding="utf-8-sig", newline="") as file:
            lines = [row for row in csv.reader(file) if any(cell.strip() for cell in row)]
    except FileNotFoundError:
        raise InputError(f"there is no file {path}; name one that can be read") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"cannot read {path}: {str(error).splitlines()[0]}; give a .csv in UTF-8") from None
    if len(lines) < 3:
        raise InputError(
            f"{path} has {max(0, len(lines) - 1)} rows of numbers; give a header and two rows or more"
        )
    heads = [cell.strip() for cell in lines[0]]
    rows: list[list[float]] = []
    for number, cells in enumerate(lines[1:], 2):
        if len(cells) != len(heads):
            raise InputError(
                f"row {number} of {path} has {len(cells)} values under {len(heads)} names; mend it"
            )
        rows.append([_number(path, number, head, cell) for head, cell in zip(heads, cells, strict=True)])
    return heads, rows


def _number(path: str, row: int, head: str, cell: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(f"row {row} of {path} has {cell.strip()!r} under {head!r}; give a finite number")
    return value


def tabled_comparand(
    form: Form, table: Mapping[str, Column], speed: float, source: str
) -> tuple[Comparand, list[str]]:
    """Return a form at the instants of a table, and the names of the columns that said so.

    Columns named like drivers, or `angle` for a crank, say where those stand; `t` says when.

    Raises:
        InputError: for a table that tells neither of all drivers nor of the time.
    """
    mechanism, known = form.mechanism, form.motion_laws
    clock = next((name for name in CLOCKS if name in table), None)
    if mechanism.has_crank and known is None:
        return _of_crank(form, table, speed, source, clock)
    columns = {driver: _driver_column(driver, table) for driver in mechanism.drivers}
    names = {driver: column for driver, column in columns.items() if column is not None}
    missing = [driver for driver in columns if driver not in names]
    if clock is not None and known is not None and missing:
        return _of_programs(form, known, table[clock].values), [clock]
    if missing:
        raise InputError(
            f"{source} has no column {', '.join(missing)} (it has {', '.join(table)}); give one for each "
            "driver, or a column t and the programs of the drivers"
        )
    rows = len(next(iter(table.values())).values)
    time = table[clock].values if clock else np.linspace(0.0, 1.0, rows)
    through = _through(mechanism, names, table, time)
    own = LoopForm(mechanism, forces=form.forces, motion_laws=through)
    one = np.full_like(time, through.pace)
    used = [*names.values(), *(name for driver in names for name in _rates(driver) if name in table)]
    there = through.pace * (time - time[0])
    return Comparand(own, there, one, 0.0 * one, time if clock else None), used + ([clock] if clock else [])


def _of_programs(form: Form, known: MotionLaws, time: Array) -> Comparand:
    """Return a form under its own programs at the times of a table."""
    last = float(time.max())
    if isinstance(form, LoopForm) and last > known.duration:
        form = replace(form, motion_laws=known.lasting(last))
    one = np.full_like(time, known.pace)
    return Comparand(form, known.pace * time, one, 0.0 * one, time)


def _of_crank(
    form: Form, table: Mapping[str, Column], speed: float, source: str, clock: str | None
) -> tuple[Comparand, list[str]]:
    crank = form.mechanism.crank.name
    column = "angle" if "angle" in table else _driver_column(crank, table)
    used = [name for name in (column, clock, *_rates(crank)) if name is not None and name in table]
    time = None if clock is None else table[clock].values
    if column is not None:
        angle = table[column].values
    elif time is not None:
        angle = form.mechanism.start + speed * time
    else:
        raise InputError(
            f"{source} has no column angle, {crank} or t (it has {', '.join(table)}); "
            "say where the crank stands"
        )
    rate = table[f"{crank}.v"].values if f"{crank}.v" in table else np.full_like(angle, speed)
    second = table[f"{crank}.a"].values if f"{crank}.a" in table else np.zeros_like(angle)
    return Comparand(form, angle, rate, second, time), used


def _driver_column(driver: str, table: Mapping[str, Column]) -> str | None:
    return next((name for name in (driver, f"{driver}.q") if name in table), None)


def _through(
    mechanism: Mechanism, names: Mapping[str, str], table: Mapping[str, Column], time: Array
) -> MotionLaws:
    """Return programs through the rows of a table, with the rates that it has or those of a spline."""
    states = {driver: _state(driver, column, table, time - time[0]) for driver, column in names.items()}
    return make_motion_laws(mechanism, states, float(np.ptp(time)))


def _state(driver: str, column: str, table: Mapping[str, Column], time: Array) -> State:
    spline = tabled(driver, time, table[column].values)
    rates = [tabled(driver, time, table[one].values) for one in _rates(driver) if one in table]
    if len(rates) < 2:
        return spline
    return lambda t: (spline(t)[0], rates[0](t)[0], rates[1](t)[0])


def _rates(driver: str) -> tuple[str, str]:
    return f"{driver}.v", f"{driver}.a"


def claims_of_table(table: Mapping[str, Column], used: list[str], names: Names, source: str) -> list[Claim]:
    """Return what a table says of quantities: those of one point's components together."""
    found: dict[tuple[str, str], list[tuple[NamedQuantity, Column]]] = {}
    for name, column in table.items():
        if name in used:
            if column.uncertainty is not None:
                raise InputError(
                    f"{source} has a standard deviation of {name!r}, which states where a driver is and "
                    "counts as exact; leave it out"
                )
            continue
        named = names.read(name, None, source)
        found.setdefault((named.kind, named.subject), []).append((named, column))
    claims = [_together(parts) for parts in found.values()]
    if not claims:
        raise InputError(
            f"{source} has no column beside {', '.join(used)}; give one to compare, as P.x or J.q"
        )
    return claims


def _together(parts: list[tuple[NamedQuantity, Column]]) -> Claim:
    parts = sorted(parts, key=lambda part: AXES.find(part[0].axes))
    axes = "".join(named.axes for named, _ in parts)
    first = parts[0][0]
    values = np.column_stack([column.values for _, column in parts])
    bands = [column.uncertainty for _, column in parts]
    uncertainty = None
    if any(band is not None for band in bands):
        uncertainty = np.column_stack([0.0 * values[:, 0] if band is None else band for band in bands])
    rate = {"velocity": ".v", "acceleration": ".a"}.get(first.kind, "")
    name = first.name if len(parts) == 1 else first.subject + rate
    return Claim(replace(first, name=name, axes=axes), values, uncertainty)
