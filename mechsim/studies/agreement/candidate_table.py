"""Candidate data of a user's model from a table: its instants, and the values of its columns."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mechsim import files
from mechsim.errors import InputError
from mechsim.kinematics.solvers import KinematicSolver
from mechsim.mechanism.motion_laws import MotionLaws, State, make_motion_laws, tabled
from mechsim.mechanism.quantity import AXES, Quantity
from mechsim.numerics.arrays import Array
from mechsim.studies.agreement.candidate import Candidate, QuantityReader
from mechsim.studies.agreement.evaluation_points import EvaluationPoints
from mechsim.studies.measured_table import table_columns

TIME_COLUMNS = ("t", "time")


def read_table(path: str) -> dict[str, Array]:
    """Return the columns of a .csv file of two rows or more in SI.

    Raises:
        InputError: for a file without such a table; names the row and the column.
    """
    table = files.read(path)
    rows = len(next(iter(table.values())))
    if rows < 2:
        raise InputError(f"{path} has {rows} row of numbers; give a header and two rows or more")
    columns = table_columns(table, path)
    if measured := [name for name, column in columns.items() if column.uncertainty is not None]:
        raise InputError(
            f"{path} has the standard deviation of {measured[0]}, and a comparison has tolerances; leave it "
            "out and give a tolerance, or use `mechsim fit`, which weighs measurements"
        )
    return {name: column.values for name, column in columns.items()}


def points_of_table(
    solver: KinematicSolver, table: Mapping[str, Array], speed: float, source: str
) -> tuple[EvaluationPoints, list[str]]:
    """Return the evaluation points of a table, and the names of the columns that define them.

    Columns named like drivers, or `angle` for a crank, give driver coordinates; `t` gives times.

    Raises:
        InputError: for a table with neither the columns of all drivers nor a time column.
    """
    mechanism, laws = solver.mechanism, solver.motion_laws
    time_column = next((name for name in TIME_COLUMNS if name in table), None)
    if mechanism.has_crank and laws.crank:
        return _of_crank(solver, table, speed, source, time_column)
    columns = {driver: _driver_column(driver, table) for driver in mechanism.drivers}
    names = {driver: column for driver, column in columns.items() if column is not None}
    missing = [driver for driver in columns if driver not in names]
    if time_column is not None and not laws.crank and missing:
        last = float(table[time_column].max())
        if last > laws.duration:
            solver = solver.with_mechanism(mechanism, motion_laws=replace(laws, duration=last))
        return _at_times(solver, laws, table[time_column]), [time_column]
    if missing:
        raise InputError(
            f"{source} has no column {', '.join(missing)} (it has {', '.join(table)}); give one for each "
            "driver, or a column t and the motion laws of the drivers"
        )
    rows = len(next(iter(table.values())))
    time = table[time_column] if time_column else np.linspace(0.0, 1.0, rows)
    # motion laws through the rows of a table, with the rates of the table or of a spline
    states = {driver: _state(driver, column, table, time - time[0]) for driver, column in names.items()}
    through = make_motion_laws(mechanism, states, float(np.ptp(time)))
    own = KinematicSolver(mechanism, forces=solver.forces, motion_laws=through)
    used = [*names.values(), *(name for driver in names for name in _rates(driver) if name in table)]
    used += [time_column] if time_column else []
    return replace(_at_times(own, through, time - time[0]), time=time if time_column else None), used


def _at_times(solver: KinematicSolver, laws: MotionLaws, time: Array) -> EvaluationPoints:
    """Return a solver under motion laws at times (n,) in [s]."""
    rate = np.full_like(time, laws.rate)
    return EvaluationPoints(solver, laws.parameter(time), rate, np.zeros_like(time), time)


def _of_crank(
    solver: KinematicSolver,
    table: Mapping[str, Array],
    speed: float,
    source: str,
    time_column: str | None,
) -> tuple[EvaluationPoints, list[str]]:
    crank = solver.mechanism.crank.name
    column = "angle" if "angle" in table else _driver_column(crank, table)
    used = [name for name in (column, time_column, *_rates(crank)) if name is not None and name in table]
    time = None if time_column is None else table[time_column]
    if column is not None:
        angle = table[column]
    elif time is not None:
        angle = solver.mechanism.start + speed * time
    else:
        raise InputError(
            f"{source} has no column angle, {crank} or t (it has {', '.join(table)}); "
            "give the crank angle or the time of each row"
        )
    rate = table[f"{crank}.v"] if f"{crank}.v" in table else np.full_like(angle, speed)
    second = table[f"{crank}.a"] if f"{crank}.a" in table else np.zeros_like(angle)
    return EvaluationPoints(solver, angle, rate, second, time), used


def _driver_column(driver: str, table: Mapping[str, Array]) -> str | None:
    return next((name for name in (driver, f"{driver}.q") if name in table), None)


def _state(driver: str, column: str, table: Mapping[str, Array], time: Array) -> State:
    spline = tabled(driver, time, table[column])
    rates = [tabled(driver, time, table[rate_name]) for rate_name in _rates(driver) if rate_name in table]
    if len(rates) < 2:
        return spline
    return lambda t: (spline(t)[0], rates[0](t)[0], rates[1](t)[0])


def _rates(driver: str) -> tuple[str, str]:
    return f"{driver}.v", f"{driver}.a"


def values_of_table(table: Mapping[str, Array], used: list[str], reader: QuantityReader) -> list[Candidate]:
    """Return the candidates of a table; columns of one point's components form one candidate."""
    grouped: dict[tuple[str, str], list[tuple[Quantity, Array]]] = {}
    for name, column in table.items():
        if name in used:
            continue
        named = reader.read(name, None)
        grouped.setdefault((named.kind, named.subject), []).append((named, column))
    candidates = [_joined_components(columns) for columns in grouped.values()]
    if not candidates:
        raise InputError(
            f"{reader.who} has no column other than {', '.join(used)}; give one to compare, as P.x or J.q"
        )
    return candidates


def _joined_components(named_columns: list[tuple[Quantity, Array]]) -> Candidate:
    named_columns = sorted(named_columns, key=lambda pair: AXES.find(pair[0].axes))
    axes = "".join(named.axes for named, _ in named_columns)
    first = replace(
        named_columns[0][0], columns=tuple(column for named, _ in named_columns for column in named.columns)
    )
    values = np.column_stack([column for _, column in named_columns])
    rate = {"velocity": ".v", "acceleration": ".a"}.get(first.kind, "")
    name = first.name if len(named_columns) == 1 else first.subject + rate
    return Candidate(replace(first, name=name, axes=axes), values)
