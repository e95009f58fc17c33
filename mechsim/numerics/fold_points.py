"""Fold points of a path, at which its parameter turns back: the last segment, to a dead centre.

Along the curve of assemblies the parameter s is smooth, with an extremum d at a fold point, so that near it
all coordinates are smooth functions of u = sqrt(|d - s|), which changes its sign there. One segment with
nodes on both sides of the fold point gives d as a simple root of ds/dy, where y is the distance along a
tangent, and the path up to it as polynomials of u.

Source: E. L. Allgower, K. Georg, Introduction to numerical continuation methods, SIAM (2003), chapters 2, 9.
"""

from dataclasses import dataclass

import numpy as np

from mechsim.numerics.arrays import CLOSED, ROUNDING, Array
from mechsim.numerics.collocation import Interpolant, extrapolated, nodes_between, through
from mechsim.numerics.loop_solver import NEARBY, E, Q
from mechsim.numerics.path_segments import PathStates, Segment

# nodes of a segment about a fold point; even, so that none lies at it, where the Jacobian is singular; with
# 12 to 48 errors and times are the same (`validation/choices/constants.py`)
NODES = 24
# largest truncation error of the polynomial through them, in [rad] and characteristic lengths: with 100 times
# as much, errors of ranges of cranks are 4e-11 rad instead of 3e-13, in 0.9 of the time (the same script)
MAX_TRUNCATION = 4e-13
# most Newton steps, and the last one; and half of the interval over which the drivers' rates are differences:
# factors from 0.1 to 10 on the latter two change nothing (the same script)
STEPS, LAST_STEP, DIFFERENCE = 10, 1e-11, 1e-6


@dataclass(frozen=True, kw_only=True)
class FoldSegment(Segment[E, Q]):
    """The last segment of a path, up to a fold point; its two nodes are its ends.

    Attributes:
        fold: parameter of the fold point.
        roots: polynomial of the states over u.
    """

    fold: float
    roots: Interpolant
    final = True

    def evaluate(self, s: Array) -> Array:
        """Return the states at parameters (n,), (n, w)."""
        return self.roots.evaluate(np.sqrt(np.abs(self.fold - s)))


def fold_segment(
    path: PathStates[E, Q], last: Segment[E, Q], direction: int, tolerance: float
) -> FoldSegment[E, Q] | None:
    """Return the segment from the last one to a fold point; None if none is close, or it is not resolved.

    Args:
        path: path of the poses.
        last: last segment of the path.
        direction: direction of the path, +1 or -1.
        tolerance: distance from the fold point at which the segment ends.
    """
    rate = direction * last.derivative().states[-1]
    along = last.states @ rate
    # motions without unknowns, as of an open chain, have no fold points
    if not (path.loops.unknown.size and (np.diff(along) > 0.0).all()):
        return None
    # y and s of the last segment from -1 to 1, and the vertex of a parabola
    y, scaled = (2.0 * (each - each[0]) / (each[-1] - each[0]) - 1.0 for each in (along, last.nodes))
    _, linear, square = np.polynomial.polynomial.polyfit(y, scaled, 2)
    if not 0.0 < -2.0 * square < linear:
        return None
    vertex = -0.5 * linear / square
    rows = np.column_stack([last.states, last.nodes])
    predicted = extrapolated(y, rows, 2, nodes_between(1.0, 2.0 * vertex - 1.0, NODES)[0])
    curve = _on_curve(path, last, predicted[:, :-1], predicted[:, -1])
    if curve is None:
        return None
    states, s, signs = curve
    nodes = states @ rate
    if not (np.diff(nodes) > 0.0).all():
        return None
    samples = through(nodes, np.column_stack([states, s]))
    if not samples.truncation_error() < MAX_TRUNCATION:
        return None
    derivative, root = samples.derivative(), float(nodes[np.argmax(direction * s)])
    curvature = derivative.derivative()
    for _ in range(STEPS):
        root -= float(derivative.value_at(root)[-1] / curvature.value_at(root)[-1])
    fold = float(samples.value_at(root)[-1])
    u = np.sign(root - nodes) * np.sqrt(np.abs(fold - s))
    # otherwise the parameter has no extremum between the nodes, or there is a change point, too
    extremum = (direction * (fold - s) > 0.0).all() and (np.diff(u) < 0.0).all() and u[-1] < 0.0 < u[0]
    if not (extremum and np.ptp(signs * np.sign(u)) == 0.0):
        return None
    roots, ends = through(u, states), np.array([last.nodes[-1], fold - direction * tolerance])
    rows = roots.evaluate(np.sqrt(np.abs(fold - ends)))
    errors = roots.truncation_error(), float(np.abs(rows[0] - last.states[-1]).max())
    # for another curve both are larger
    if not max(errors) < ROUNDING:
        return None
    return FoldSegment(ends, rows, np.array([1.0, -1.0]), last.solver, fold=fold, roots=roots)


# a predicted node can be so far away that its residual is infinite
@np.errstate(over="ignore", invalid="ignore")
def _on_curve(
    path: PathStates[E, Q], last: Segment[E, Q], states: Array, s: Array
) -> tuple[Array, Array, Array] | None:
    """Return nodes moved perpendicular to the curve, parameters, determinant signs; None if this fails.

    With a step a at constant parameter, and rates b, the shortest step is a + b c, c = -a b / (1 + b b).
    """
    solver, loops = last.solver, path.loops
    driven, advance = list(loops.driven), np.zeros((loops.count, len(s)))
    for _ in range(STEPS):
        q = path.unflat(states, s)
        linearised = solver.linearise(q)
        change = path.prescribed(s + DIFFERENCE) - path.prescribed(s - DIFFERENCE)
        advance[driven] = change / (2.0 * DIFFERENCE * loops.units[driven, None])
        right = np.zeros_like(linearised.rhs)
        right[:, : len(solver.rows)] = linearised.times(advance)[solver.rows].T
        try:
            step, rates = (-linearised.solution(values) for values in (linearised.rhs, right))
        except np.linalg.LinAlgError:
            return None
        ahead = -(step * rates).sum(1) / (1.0 + (rates**2).sum(1))
        step += rates * ahead[:, None]
        length = np.abs(step).max()
        if not length < NEARBY.max_displacement:
            return None
        states, s = path.flat(loops.displaced(q, solver.whole_step(step))), s + ahead
        if length < LAST_STEP and np.abs(linearised.residual).max() < CLOSED:
            return states, s, linearised.determinant[0]
    return None
