"""Whether a simulated motion is in another assembly than the one meant."""

from collections.abc import Mapping

import numpy as np

from mechsim.model.motion import Motion, Solver
from mechsim.numerics.arrays import Array
from mechsim.verdict.instants import instants_of
from mechsim.verdict.quantities import stroke_of

# a simulation this much nearer to another assembly than to the right one is in the other
NEARER = 0.5
# if, in units of the stroke, these are farther apart than that
APART = 0.02
# pairs of records at which that is looked at
MOST_PAIRS = 100


def elsewhere(simulated: Motion, exact: Motion, solver: Solver) -> float | None:
    """Return the instant at which a simulation is first seen in another assembly; None if it is in none.

    The sign that tells assemblies apart is no proof: close to a singular pose rounding turns it, and
    where there are more than two assemblies some share it. So the places decide: at two records in a
    row, with the assemblies well apart, they must be twice as near to another one as to the
    right one. Tried on 1,200 runs past singular poses: validation/robustness/assembly_detector.py.
    """
    angle = instants_of(simulated).value
    listed = getattr(solver, "assembly_points", None)
    if listed is None:
        sign = solver.assembly_sign({name: point.position for name, point in simulated.points.items()})
        wrong = sign < 0.0
        first = np.flatnonzero(wrong[1:] & wrong[:-1])
        return float(angle[first[0]]) if len(first) else None
    far = np.max(list(simulated.place_errors(exact).values()), axis=0)
    pairs = np.unique(np.linspace(0, max(0, len(angle) - 2), MOST_PAIRS).astype(int))
    rows = np.unique(np.clip(np.concatenate([pairs, pairs + 1]), 0, len(angle) - 1))
    apart = np.zeros(len(rows))
    for k, i in enumerate(rows):
        for _, points in listed(float(exact.angle[i])):
            gap = _farthest(points, {name: exact.points[name].position[i] for name in points})
            off = _farthest(points, {name: simulated.points[name].position[i] for name in points})
            apart[k] = max(apart[k], gap if off < NEARER * far[i] else 0.0)
    wrong = apart > APART * stroke_of(exact)
    first = np.flatnonzero(wrong[1:] & wrong[:-1])
    return float(angle[rows[first[0]]]) if len(first) else None


def _farthest(points: Mapping[str, Array], others: Mapping[str, Array]) -> float:
    return max(float(np.linalg.norm(points[name] - other)) for name, other in others.items())
