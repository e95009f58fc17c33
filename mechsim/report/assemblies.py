"""All assemblies of a mechanism as tables of curves, as the data of a plot, and as plain data."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.numerics.rounding import ROUNDING
from mechsim.pictures.plots import AssemblyTable
from mechsim.subjects import catalog
from mechsim.theory.continuation.assembly_curve import joint_columns
from mechsim.theory.continuation.mechanism_trace import AssemblyTrace

# number of rows of a curve in tables and plots
SAMPLES = 361


def curve_tables(trace: AssemblyTrace, samples: int = SAMPLES) -> list[dict[str, Array]]:
    """Return the columns of each curve at `samples` evenly spaced arc lengths, both ends included."""
    return [dict(curve.samples(samples).columns()) for curve in trace.curves]


def joined(tables: Sequence[dict[str, Array]]) -> dict[str, Array]:
    """Return the tables of all curves one after another, numbered from 1 in a column `component`."""
    counted = [np.full(len(table["arc"]), i + 1.0) for i, table in enumerate(tables)]
    columns = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    return {"component": np.concatenate(counted), **columns}


def assembly_table(trace: AssemblyTrace, tables: Sequence[dict[str, Array]]) -> AssemblyTable:
    """Return the data of a plot of the assemblies."""
    first = trace.curves[0]
    units = dict.fromkeys(tables[0], "m") | {"arc": "", "angle": "rad"}
    units |= {column.name: column.unit for column in first.joints.columns}
    dead = [
        (i, turning_point.arc) for i, curve in enumerate(trace.curves) for turning_point in curve.crank_turns
    ]
    branch_points = [location for branch_point in trace.branch_points for location in branch_point.locations]
    marked: list[dict[str, Array]] = []
    for locations in (dead, branch_points):
        rows = [dict(trace.curves[i].poses_at(arc).columns()) for i, arc in locations]
        names = tables[0] if rows else ()
        marked.append({name: np.concatenate([row[name] for row in rows]) for name in names})
    return AssemblyTable(tables, units, *marked)


def requested_columns(mechanism: Mechanism, requested: Sequence[str]) -> list[str]:
    """Return the requested columns of a plot; a joint's name selects its coordinate.

    Raises:
        InputError: for a name that is no column, with the nearest that is, or not two of them.
    """
    columns = ["angle", *(column.name for column in joint_columns(mechanism))]
    moving = [name for name, (link, _) in mechanism.points.items() if link != GROUND]
    columns += [f"{name}.{axis}" for name in moving for axis in "xyz"] + ["arc"]
    chosen: list[str] = []
    for name in requested:
        if name not in columns and f"{name}.q" not in columns:
            raise InputError(
                f"{mechanism.name} has no coordinate {name!r} to plot over{catalog.nearest(name, columns)}"
            )
        chosen.append(name if name in columns else f"{name}.q")
    if len(chosen) != 2:
        raise InputError(f"--of names {len(chosen)} coordinates ({', '.join(requested)}); name two")
    return chosen


def usual_columns(trace: AssemblyTrace, table: AssemblyTable) -> list[str]:
    """Return two columns to plot over: the crank's angle, and a joint that moves."""
    driver = trace.curves[0].driver.name
    moving = [name for name in _others(trace, driver) if _moves(table, name)]
    return [driver, moving[0] if moving else "arc"]


def trace_record(trace: AssemblyTrace) -> dict[str, Any]:
    """Return the trace as plain data; components are counted from 1."""
    return {
        "mechanism": trace.mechanism.name,
        "starts": trace.starts,
        "seed": trace.seed,
        "closed": trace.closed,
        "components": [
            {
                "component": i + 1,
                "own": i == 0,
                "starts_ended": curve.starts_ended,
                "length": curve.length,
                "turns": curve.turns,
                "dead_centres": curve.dead_centres,
                "turning_points": curve.turning_points,
            }
            for i, curve in enumerate(trace.curves)
        ],
        "branch_points": [
            {
                "angle": branch_point.angle,
                "places": [{"component": i + 1, "arc": arc} for i, arc in branch_point.locations],
            }
            for branch_point in trace.branch_points
        ],
        "left_out": list(trace.left_out),
        "complete_at": trace.complete_at,
        "reason": trace.reason,
    }


def _others(trace: AssemblyTrace, driver: str) -> list[str]:
    """Return the columns of joints but the driver's, those on the frame first."""
    joints = {joint.name: joint for joint in trace.mechanism.joints}
    columns = [column for column in trace.curves[0].joints.columns if column.name != driver]
    on_frame = [GROUND in (joints[column.joint].a.link, joints[column.joint].b.link) for column in columns]
    return [
        column.name for _, column in sorted(zip(on_frame, columns, strict=True), key=lambda pair: not pair[0])
    ]


def _moves(table: AssemblyTable, name: str) -> bool:
    return any(float(np.ptp(curve[name])) > ROUNDING for curve in table.curves)
