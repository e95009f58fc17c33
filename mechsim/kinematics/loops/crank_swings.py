"""Reachable crank ranges of many designs at once, and their motions within them.

The assembly of every design is traced from its start in both directions by pseudo-arclength continuation with
the crank free: predictor along the tangent of the solution curve, minimum-norm corrector. The crank reverses
where its component of the tangent changes sign; secant steps locate this dead centre.

Source: E. L. Allgower, K. Georg, Introduction to numerical continuation methods, SIAM (2003), chapters 2, 9.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from mechsim.kinematics.loops.constraints import TreeLoops, TreeSolver
from mechsim.kinematics.loops.design_motion import (
    Bools,
    Rows,
    SharedLoops,
    closed_designs,
    design_record,
    empty_motion,
    store,
)
from mechsim.kinematics.loops.kinematics import Coordinates
from mechsim.kinematics.loops.path import ClosedChunk, with_rates
from mechsim.mechanism.design_arrays import StartedDesigns
from mechsim.mechanism.motion import Motion, Record, mapped
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.loop_solver import NEARBY, LoopSystem
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
# largest displacement from a predicted pose to the closed one, in [rad] and characteristic lengths
MAX_CORRECTION_AT_ANGLE = 0.05
# number of instants solved together
CHUNK = 4096


@dataclass(frozen=True, slots=True)
class CurveNodes:
    """Points on the solution curves of d designs.

    Attributes:
        q: coordinates.
        tangent: unit tangents of the free coordinates, (free, d).
    """

    q: Coordinates
    tangent: Array


@dataclass(frozen=True, slots=True)
class Curve:
    """Solution curves of d designs from their starts in one direction, up to their dead centres.

    Attributes:
        nodes: k points on each, along a first axis of each array.
        length: arc length from each node to the next, (k, d); that of the last node is unused.
        last: number of the last node of each design, its dead centre, (d,).
    """

    nodes: CurveNodes
    length: Array
    last: Rows


@dataclass(frozen=True)
class Swings:
    """Designs with swinging cranks and their reachable ranges.

    Attributes:
        rows: indices of the designs, (d,).
        low: crank angle of the lower dead centre, (d,) in [rad].
        high: crank angle of the upper dead centre, (d,) in [rad].
        curves: direction (-1, 1) -> solution curves.
    """

    rows: Rows
    low: Array
    high: Array
    curves: dict[int, Curve]


class SwingTracer:
    """Traces designs of the same structure; see `shared_loops`."""

    def __init__(self, like: SharedLoops, started: StartedDesigns):
        self.like, self.started = like, started
        loops = like.solver.loops
        self.designs, self.start, self.assembled = closed_designs(loops, started, len(like.solver.rows))
        self.crank = loops.driven[0]
        self.free = np.append(loops.unknown, self.crank)

    def swings(self) -> Swings | None:
        """Return the designs with swinging cranks; None if there are none or designs cannot be traced."""
        solver = self.like.solver
        if len(solver.null_space) or len(solver.rows) != len(solver.loops.unknown):
            return None
        rows = np.flatnonzero(self.assembled)
        curves: dict[int, Curve] = {}
        for direction in (1, -1):
            if not len(rows):
                return None
            curves[direction], valid = self._traced(rows, self.start.select(rows), direction)
            rows, curves = rows[valid], {key: _selected(curve, valid) for key, curve in curves.items()}
        if not len(rows):
            return None
        low, high = (
            curve.nodes.q.values[curve.last, self.crank, np.arange(len(rows))]
            for curve in (curves[-1], curves[1])
        )
        return Swings(rows, low, high, curves)

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

    def _traced(self, rows: Rows, q: Coordinates, direction: int) -> tuple[Curve, Bools]:
        """Return the curves in one direction of the crank, and which designs have a swinging crank."""
        d = len(rows)
        q, tangent, _, valid = self._corrected(rows, q)
        points = CurveNodes(q, tangent * np.sign(direction * tangent[-1]))
        start, length = q.values[self.crank], np.full(d, STEP)
        nodes, lengths = [points], list[Array]()
        last, active = np.zeros(d, dtype=np.intp), valid.copy()
        for count in range(1, MAX_STEPS):
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
                ahead, length = self._dead_centres(rows, points, ahead, length, reversed_, direction)
            points = mapped(partial(np.where, active), ahead, points)
            nodes.append(points)
            lengths.append(length)
            last = np.where(active, count, last)
            full_revolution = active & (np.abs(points.q.values[self.crank] - start) > REVOLUTION)
            valid &= ~full_revolution
            active &= ~(reversed_ | full_revolution)
            length = np.minimum(STEP, 1.5 * length)
        valid &= ~active
        lengths.append(np.zeros(d))
        return Curve(mapped(lambda *arrays: np.stack(arrays), *nodes), np.stack(lengths), last), valid

    def _stepped(self, rows: Rows, points: CurveNodes, length: Array) -> tuple[CurveNodes, Bools]:
        """Return points a step along the curves, and which are valid."""
        predicted = self._moved(self._loops(rows, len(rows)), points.q, points.tangent * length)
        q, tangent, displacement, valid = self._corrected(rows, predicted)
        tangent = tangent * np.sign((tangent * points.tangent).sum(0))
        same_direction = (tangent * points.tangent).sum(0) > 0.9
        return CurveNodes(q, tangent), valid & (displacement < MAX_CORRECTION * length) & same_direction

    def _dead_centres(
        self,
        rows: Rows,
        points: CurveNodes,
        beyond: CurveNodes,
        length: Array,
        passed: Bools,
        direction: int,
    ) -> tuple[CurveNodes, Array]:
        """Return the next points of the curves, where some pass a dead centre that dead centre."""
        index = np.flatnonzero(passed)
        start, lengths = _selected(points, index), length.copy()
        low, high = np.zeros(len(index)), length[index]
        slow, fast = start.tangent[-1], beyond.tangent[-1, index]
        solution = start
        for _ in range(SECANTS):
            lengths[index] = low + (high - low) * slow / (slow - fast)
            solution, _ = self._stepped(rows[index], start, lengths[index])
            rate = solution.tangent[-1]
            if (np.abs(rate) < TANGENT_TOLERANCE).all():
                break
            inside = direction * rate > 0.0
            # Illinois: the end that stays counts half
            fast, high = np.where(inside, 0.5 * fast, rate), np.where(inside, high, lengths[index])
            slow, low = np.where(inside, rate, 0.5 * slow), np.where(inside, lengths[index], low)

        def replaced(array: Array, values: Array) -> Array:
            array = array.copy()
            array[..., index] = values
            return array

        return mapped(replaced, beyond, solution), lengths

    def motion(
        self, swings: Swings, angles: Array, speed: Array, acceleration: Array, joints: Sequence[str]
    ) -> tuple[Motion, Bools]:
        """Return the motions of designs along crank motions (d, p), and of which they are solved, (d,)."""
        d, p = angles.shape
        motion, solved = empty_motion(self.like, d * p), np.ones(d, dtype=np.bool_)
        for indices in np.array_split(np.arange(d), -(-d * p // CHUNK)):
            q = self._predicted(swings, indices, angles[indices])
            # all designs at one instant after another
            index = (indices * p + np.arange(p)[:, None]).ravel()
            crank_angles = angles.ravel()[index]
            q, _, _, valid = self._corrected(swings.rows[indices], q)
            q.values[self.crank] = crank_angles
            designs = self.designs.select(swings.rows[indices])
            solver = TreeSolver(designs, self.like.solver.rows, self.like.solver.null_space, q)
            result = newton(solver, q, NEARBY)
            residual = np.abs(result.linearised.residual).max(0, initial=0.0)
            converged = valid & (residual < CLOSED) & (result.displacement < MAX_CORRECTION_AT_ANGLE)
            solved[indices] = converged.reshape(p, -1).all(0)
            instants = self.like.instants(crank_angles, speed.ravel()[index], acceleration.ravel()[index])
            chunk = ClosedChunk(solver, index, instants, result.q, result.linearised)
            store(motion, index, with_rates(None, chunk, conditioned=False))
        arrays = self.started.arrays.subset(swings.rows)
        record = design_record(
            self.like, arrays, motion, angles.ravel(), speed.ravel(), acceleration.ravel(), joints
        )
        return record, solved

    def _predicted(self, swings: Swings, indices: Rows, angles: Array) -> Coordinates:
        """Return coordinates near those at crank angles (d, p) of some of the designs, (p d) sets."""
        # all designs at one instant after another
        row, angle = np.tile(indices, angles.shape[1]), angles.T.ravel()
        points: list[CurveNodes] = []
        steps: list[Array] = []
        for direction in (1, -1):
            curve = swings.curves[direction]
            nodes, last = curve.nodes.q.values[:, self.crank], curve.last[row] - 1
            previous = (direction * nodes[:, row] <= direction * angle).sum(0) - 1
            node = np.clip(previous, 0, last)
            low, high = nodes[node, row], nodes[node + 1, row]
            fraction = (angle - low) / (high - low)
            # near a dead centre the crank angle is a quadratic function of the distance
            ends = 1.0 - np.sqrt(np.maximum(1.0 - fraction, 0.0))
            steps.append(np.where(node == last, ends, fraction) * curve.length[node, row])
            points.append(mapped(partial(_at_nodes, node=node, design=row), curve.nodes))
        upwards = angle >= swings.curves[1].nodes.q.values[0, self.crank, row]
        nearest = mapped(partial(np.where, upwards), *points)
        loops = self._loops(swings.rows[indices], len(row))
        return self._moved(loops, nearest.q, nearest.tangent * np.where(upwards, *steps))


def _at_nodes(array: Array, node: Rows, design: Rows) -> Array:
    """Return values (..., m) of an array (k, ..., d) at nodes and designs, (m,) each."""
    return np.moveaxis(array[node, ..., design], 0, -1)


def _selected(record: Record, which: Bools | Rows) -> Record:
    """Return a record, the last axis of whose arrays is that of designs, for some of them."""
    return mapped(lambda array: array[..., which], record)
