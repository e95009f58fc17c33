"""Reachable crank ranges of many designs at once.

The assembly of every design is traced from its start in both directions by pseudo-arclength continuation with
the crank free: predictor along the tangent of the solution curve, minimum-norm corrector. The crank reverses
where its component of the tangent changes sign; secant steps locate this dead centre.

Source: E. L. Allgower, K. Georg, Introduction to numerical continuation methods, SIAM (2003), chapters 2, 9.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from mechsim.kinematics.loops.constraints import TreeLoops
from mechsim.kinematics.loops.design_motion import Bools, Rows, SharedLoops, closed_designs
from mechsim.kinematics.loops.kinematics import Coordinates
from mechsim.mechanism.design_arrays import StartedDesigns
from mechsim.mechanism.motion import Record, mapped
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.loop_solver import LoopSystem
from mechsim.numerics.newton import NewtonSettings, newton
from mechsim.numerics.rank import least_norm, right_vectors

# arc length of a step in [rad] and characteristic lengths, and largest number of steps in a direction
STEP, MAX_STEPS = 0.1, 400
# largest number of halvings of a step that fails
HALVINGS = 4
# residual of a closed loop, and largest corrector displacement relative to the step
CLOSED, MAX_CORRECTION = 1e-12, 0.3
# minimum-norm corrector, perpendicular to the curve
CORRECTOR = NewtonSettings(max_iterations=5, tolerance=CLOSED, max_step=1.0)
# smallest singular value, relative to the largest, of a regular point of the curve: it vanishes at a branch
# point and with undetermined degrees of freedom
REGULAR = 1e-6
# secant steps to a dead centre, and crank component of the tangent there
SECANTS, TANGENT_TOLERANCE = 12, 1e-9


@dataclass(frozen=True, slots=True)
class CurveNodes:
    """Points on the solution curves of d designs.

    Attributes:
        q: coordinates.
        tangent: unit tangents of the free coordinates, (free, d).
    """

    q: Coordinates
    tangent: Array


def crank_swings(like: SharedLoops, started: StartedDesigns) -> dict[int, tuple[float, float]]:
    """Return the reachable crank ranges, in [rad], of the designs whose cranks swing, by their index.

    Designs that cannot be traced have none.
    """
    solver, tracer = like.solver, SwingTracer(like, started)
    if len(solver.null_space) or len(solver.rows) != len(solver.loops.unknown):
        return {}
    rows, low = tracer.ends(np.flatnonzero(tracer.assembled), -1)
    upper, high = tracer.ends(rows, 1)
    ends = dict(zip(rows.tolist(), low.tolist(), strict=True))
    return {row: (ends[row], end) for row, end in zip(upper.tolist(), high.tolist(), strict=True)}


class SwingTracer:
    """Traces designs of the same structure; see `shared_loops`."""

    def __init__(self, like: SharedLoops, started: StartedDesigns):
        loops = like.solver.loops
        self.designs, self.start, self.assembled = closed_designs(loops, started, len(like.solver.rows))
        self.crank = loops.driven[0]
        self.free = np.append(loops.unknown, self.crank)

    def _loops(self, rows: Rows, count: int) -> TreeLoops:
        return self.designs.select(rows).at_instants(count)

    def _corrected(self, rows: Rows, q: Coordinates) -> tuple[Coordinates, Array, Array, Bools]:
        """Return points on the curves, their tangents (free, n), displacements (n,), and which are valid."""
        result = newton(LoopSystem(self._loops(rows, len(q)), self.free), q, CORRECTOR, least_norm)
        values, vh = right_vectors(result.linearised.matrix)
        valid = (result.residual < CLOSED) & (values[:, len(self.free) - 2] > REGULAR * values[:, 0])
        return result.q, vh[:, -1].T, result.displacement, valid

    def _moved(self, loops: TreeLoops, q: Coordinates, step: Array) -> Coordinates:
        whole = np.zeros((len(q.values), step.shape[1]))
        # limit the step, so that its displacement rejects it
        whole[self.free] = np.clip(np.nan_to_num(step), -1.0, 1.0)
        return loops.displaced(q, whole)

    def ends(self, rows: Rows, direction: int) -> tuple[Rows, Array]:
        """Return which designs swing to a dead centre in a direction of the crank, and its angles there."""
        if not len(rows):
            return rows, np.empty(0)
        q, tangent, _, valid = self._corrected(rows, self.start.select(rows))
        points = CurveNodes(q, tangent * np.sign(direction * tangent[-1]))
        start, length, active = q.values[self.crank], np.full(len(rows), STEP), valid.copy()
        for _ in range(MAX_STEPS):
            if not active.any():
                break
            ahead, reached = self._stepped(rows, points, length)
            for _ in range(HALVINGS):
                if not (active & ~reached).any():
                    break
                length = np.where(reached, length, 0.5 * length)
                ahead, reached = self._stepped(rows, points, length)
            valid &= ~active | reached
            active &= reached
            reversed_ = active & (direction * ahead.tangent[-1] < 0.0)
            if reversed_.any():
                ahead = self._dead_centres(rows, points, ahead, length, reversed_)
            points = mapped(partial(np.where, active), ahead, points)
            full_revolution = active & (np.abs(points.q.values[self.crank] - start) > REVOLUTION)
            valid &= ~full_revolution
            active &= ~(reversed_ | full_revolution)
            length = np.minimum(STEP, 1.5 * length)
        valid &= ~active
        return rows[valid], points.q.values[self.crank, valid]

    def _stepped(self, rows: Rows, points: CurveNodes, length: Array) -> tuple[CurveNodes, Bools]:
        """Return points a step along the curves, and which are valid."""
        predicted = self._moved(self._loops(rows, len(rows)), points.q, points.tangent * length)
        q, tangent, displacement, valid = self._corrected(rows, predicted)
        tangent = tangent * np.sign((tangent * points.tangent).sum(0))
        same_direction = (tangent * points.tangent).sum(0) > 0.9
        return CurveNodes(q, tangent), valid & (displacement < MAX_CORRECTION * length) & same_direction

    def _dead_centres(
        self, rows: Rows, points: CurveNodes, ahead: CurveNodes, length: Array, passed: Bools
    ) -> CurveNodes:
        """Return the next points of the curves, where some pass a dead centre that dead centre."""
        index = np.flatnonzero(passed)
        solution = start = _selected(points, index)
        low, high = np.zeros(len(index)), length[index]
        slow, fast = start.tangent[-1], ahead.tangent[-1, index]
        for _ in range(SECANTS):
            middle = low + (high - low) * slow / (slow - fast)
            solution, _ = self._stepped(rows[index], start, middle)
            rate = solution.tangent[-1]
            if (np.abs(rate) < TANGENT_TOLERANCE).all():
                break
            inside = rate * start.tangent[-1] > 0.0
            # Illinois: the end that stays counts half
            fast, high = np.where(inside, 0.5 * fast, rate), np.where(inside, high, middle)
            slow, low = np.where(inside, rate, 0.5 * slow), np.where(inside, middle, low)

        def replaced(array: Array, values: Array) -> Array:
            array = array.copy()
            array[..., index] = values
            return array

        return mapped(replaced, ahead, solution)


def _selected(record: Record, which: Bools | Rows) -> Record:
    """Return a record, the last axis of whose arrays is that of designs, for some of them."""
    return mapped(lambda array: array[..., which], record)
