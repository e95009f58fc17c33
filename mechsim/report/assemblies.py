"""What is told of all assemblies of a mechanism: tables of their curves, what to plot of them, plain data."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from mechsim.analytic import catalog
from mechsim.errors import InputError
from mechsim.model.links import GROUND
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.arrays import Array
from mechsim.pictures.plots import AssemblyTable
from mechsim.theory.continuation import AssemblyTrace
from mechsim.theory.continuation.assembly_curve import joint_columns

# intervals of a curve that a table and a plot have
SAMPLES = 360
# a coordinate that moves less, in radians or metres, is not worth an axis
STILL = 1e-9


def curve_tables(trace: AssemblyTrace, samples: int = SAMPLES) -> list[dict[str, Array]]:
    """Return the columns of each curve at so many even steps of arc, both ends included."""
    return [dict(curve.samples(samples + 1).columns()) for curve in trace.curves]


def joined(tables: Sequence[dict[str, Array]]) -> dict[str, Array]:
    """Return the tables of all curves under one another, counted from 1 in a column `component`."""
    counted = [np.full(len(table["arc"]), i + 1.0) for i, table in enumerate(tables)]
    columns = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    return {"component": np.concatenate(counted), **columns}


def assembly_table(trace: AssemblyTrace, tables: Sequence[dict[str, Array]]) -> AssemblyTable:
    """Return what a plot of the assemblies is drawn from."""
    first = trace.curves[0]
    units = dict.fromkeys(tables[0], "m") | {"arc": "", "angle": "rad"}
    units |= {column.name: column.unit for column in first.joints.columns}
    dead = [(i, turn.arc) for i, curve in enumerate(trace.curves) for turn in curve.crank_turns]
    met = [place for meeting in trace.branch_points for place in meeting.locations]
    marked: list[dict[str, Array]] = []
    for places in (dead, met):
        rows = [dict(trace.curves[i].poses_at(arc).columns()) for i, arc in places]
        names = tables[0] if rows else ()
        marked.append({name: np.concatenate([row[name] for row in rows]) for name in names})
    return AssemblyTable(tables, units, *marked)


def columns_asked(mechanism: Mechanism, asked: Sequence[str]) -> list[str]:
    """Return the columns to plot over that are meant; a joint's name stands for its coordinate.

    Raises:
        InputError: for a name that is no column, with the nearest that is, or not two or three of them.
    """
    known = ["angle", *(column.name for column in joint_columns(mechanism))]
    moving = [name for name, (link, _) in mechanism.points.items() if link != GROUND]
    known += [f"{name}.{axis}" for name in moving for axis in "xyz"] + ["arc"]
    found: list[str] = []
    for name in asked:
        if name not in known and f"{name}.q" not in known:
            raise InputError(
                f"{mechanism.name} has no coordinate {name!r} to plot over{catalog.nearest(name, known)}"
            )
        found.append(name if name in known else f"{name}.q")
    if len(found) not in (2, 3):
        raise InputError(f"--of names {len(found)} coordinates ({', '.join(asked)}); name two or three")
    return found


def usual_columns(trace: AssemblyTrace, table: AssemblyTable) -> list[str]:
    """Return two columns to plot over that tell something: the crank's angle, and a joint that moves."""
    driver = trace.curves[0].driver.name
    moving = [name for name in _others(trace, driver) if _moves(table, name)]
    return [driver, moving[0] if moving else "arc"]


def told(trace: AssemblyTrace) -> dict[str, Any]:
    """Return what was found as plain data; components are counted from 1."""
    return {
        "mechanism": trace.mechanism.name,
        "starts": trace.starts,
        "seed": trace.seed,
        "closed": trace.closed,
        "components": [
            {
                "component": i + 1,
                "own": i == 0,
                "found": curve.starts_ended,
                "length": curve.length,
                "turns": curve.turns,
                "dead_centres": curve.dead_centres,
                "turning_points": [
                    {
                        "coordinate": turn.coordinate,
                        "which": "highest" if turn.highest else "lowest",
                        "value": turn.value,
                        "arc": turn.arc,
                        "angle": turn.angle,
                    }
                    for turn in curve.turning_points
                ],
            }
            for i, curve in enumerate(trace.curves)
        ],
        "meetings": [
            {
                "angle": meeting.angle,
                "places": [{"component": i + 1, "arc": arc} for i, arc in meeting.locations],
            }
            for meeting in trace.branch_points
        ],
        "left_out": list(trace.left_out),
    }


def _others(trace: AssemblyTrace, driver: str) -> list[str]:
    """Return the columns of joints but the driver's, those on the frame first."""
    joints = {joint.name: joint for joint in trace.mechanism.joints}
    columns = [column for column in trace.curves[0].joints.columns if column.name != driver]
    on_frame = [GROUND in (joints[one.joint].a.link, joints[one.joint].b.link) for one in columns]
    return [one.name for _, one in sorted(zip(on_frame, columns, strict=True), key=lambda pair: not pair[0])]


def _moves(table: AssemblyTable, name: str) -> bool:
    return any(float(np.ptp(curve[name])) > STILL for curve in table.curves)
