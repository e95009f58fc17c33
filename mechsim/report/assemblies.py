"""All assemblies of a mechanism as tables of curves, and as plain data."""

from typing import Any

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.studies.trace import AssemblyTrace

# number of rows of a curve in a table
SAMPLES = 361


def curve_table(trace: AssemblyTrace) -> dict[str, Array]:
    """Return all curves one after another, at evenly spaced arc lengths with both ends.

    The column `component` numbers them from 1.
    """
    tables = [dict(curve.samples(SAMPLES).columns()) for curve in trace.curves]
    counted = [np.full(len(table["arc"]), i + 1.0) for i, table in enumerate(tables)]
    columns = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    return {"component": np.concatenate(counted), **columns}


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
