"""Reachable crank ranges of many designs at once, and their motions within them.

The assembly of every design is traced from its start in both directions by pseudo-arclength continuation with
the crank free: predictor along the tangent of the solution curve, minimum-norm corrector. The crank reverses
where its component of the tangent changes sign; secant steps locate this dead centre.

Source: E. L. Allgower, K. Georg, Introduction to numerical continuation methods, SIAM (2003), chapters 2, 9.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.analytic.loops.constraints import LoopSystem, TreeLoops, TreeSolver
from mechsim.analytic.loops.design_motion import (
    Bools,
    Rows,
    SharedLoops,
    assembled_designs,
    design_record,
    empty_motion,
    store,
)
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.analytic.loops.path_rates import ClosedChunk, with_rates
from mechsim.model.design_arrays import StartedDesigns
from mechsim.model.motion import Motion
from mechsim.numerics.angles import REVOLUTION
from mechsim.numerics.arrays import Array
from mechsim.numerics.loop_solver import NEARBY
from mechsim.numerics.newton import NewtonSettings, newton
from mechsim.numerics.rank import least_norm

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


@dataclass(frozen=True)
class Curve:
    """Solution curves of d designs from their starts in one direction, up to their dead centres.

    Attributes:
        values: coordinates at the nodes, (k, count, d).
        turns: rotations of balls, (k, balls, 3, 3, d).
        tangent: unit tangents, (k, free, d).
        length: arc length from each node to the next, (k, d); that of the last node is unused.
        last: number of the last node of each design, its dead centre, (d,).
    """

    values: Array
    turns: Array
    tangent: Array
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
        self.designs, self.start, self.assembled = assembled_designs(loops, started, len(like.solver.rows))
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
            rows, curves = rows[valid], {key: _select(curve, valid) for key, curve in curves.items()}
        if not len(rows):
            return None
        low, high = (self._end(curves[direction]) for direction in (-1, 1))
        return Swings(rows, low, high, curves)

    def _end(self, curve: Curve) -> Array:
        return curve.values[curve.last, self.crank, np.arange(len(curve.last))]

    def _loops(self, rows: Rows, count: int) -> TreeLoops:
        return self.designs.select(rows).at_instants(count)

    def _corrected(self, rows: Rows, q: Coordinates) -> tuple[Coordinates, Array, Array, Bools]:
        """Return points on the curves, their tangents (free, n), displacements (n,), and which are valid."""
        result = newton(LoopSystem(self._loops(rows, len(q)), self.free), q, CORRECTOR, least_norm)
        _, values, vh = np.linalg.svd(result.linearised.matrix, full_matrices=True)
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
        tangent = tangent * np.sign(direction * tangent[-1])
        initial = q.values[self.crank].copy()
        nodes, length = [(q.values, q.turns, tangent)], np.full(d, STEP)
        lengths: list[Array] = []
        last, active = np.zeros(d, dtype=np.intp), valid.copy()
        for count in range(1, MAX_STEPS):
            if not active.any():
                break
            previous, trial_length = nodes[-1], length
            next_at, next_tangent, reached = self._stepped(
                rows, Coordinates(previous[0], previous[1]), previous[2], trial_length
            )
            for _ in range(HALVINGS):
                if not (active & ~reached).any():
                    break
                trial_length = np.where(reached, trial_length, 0.5 * trial_length)
                next_at, next_tangent, reached = self._stepped(
                    rows, Coordinates(previous[0], previous[1]), previous[2], trial_length
                )
            valid &= ~active | reached
            active &= reached
            passed_dead_centre = active & (direction * next_tangent[-1] < 0.0)
            if passed_dead_centre.any():
                start = Coordinates(previous[0], previous[1])
                next_at, next_tangent, trial_length = self._dead_centres(
                    rows,
                    start,
                    previous[2],
                    trial_length,
                    passed_dead_centre,
                    (next_at, next_tangent),
                    direction,
                )
            values = np.where(active, next_at.values, previous[0])
            turns = np.where(active, next_at.turns, previous[1])
            nodes.append((values, turns, np.where(active, next_tangent, previous[2])))
            lengths.append(trial_length)
            last = np.where(active, count, last)
            full_revolution = active & (np.abs(values[self.crank] - initial) > REVOLUTION)
            valid &= ~full_revolution
            active &= ~(passed_dead_centre | full_revolution)
            length = np.minimum(STEP, 1.5 * trial_length)
        valid &= ~active
        lengths.append(np.zeros(d))
        arrays = [np.stack([node[i] for node in nodes]) for i in range(3)]
        return Curve(arrays[0], arrays[1], arrays[2], np.stack(lengths), last), valid

    def _stepped(
        self, rows: Rows, q: Coordinates, tangent: Array, length: Array
    ) -> tuple[Coordinates, Array, Bools]:
        """Return points a step along the curves, tangents there, and which are valid."""
        predicted = self._moved(self._loops(rows, len(rows)), q, tangent * length)
        q_next, tangent_next, displacement, valid = self._corrected(rows, predicted)
        tangent_next = tangent_next * np.sign((tangent_next * tangent).sum(0))
        same_direction = (tangent_next * tangent).sum(0) > 0.9
        return q_next, tangent_next, valid & (displacement < MAX_CORRECTION * length) & same_direction

    def _dead_centres(
        self,
        rows: Rows,
        q: Coordinates,
        tangent: Array,
        length: Array,
        passed: Bools,
        beyond: tuple[Coordinates, Array],
        crank_direction: int,
    ) -> tuple[Coordinates, Array, Array]:
        """Return the next points of the curves, where some pass a dead centre that dead centre."""
        index = np.flatnonzero(passed)
        start = Coordinates(q.values[:, index], q.turns[..., index])
        tangents, at_zero, at_end = tangent[:, index], tangent[-1, index], beyond[1][-1, index]
        low, high, slow, fast = np.zeros(len(index)), length[index].copy(), at_zero.copy(), at_end.copy()
        solution, direction, trial_length = start, tangents, low
        for _ in range(SECANTS):
            trial_length = low + (high - low) * slow / (slow - fast)
            solution, direction, _ = self._stepped(rows[index], start, tangents, trial_length)
            rate = direction[-1]
            if (np.abs(rate) < TANGENT_TOLERANCE).all():
                break
            inside = crank_direction * rate > 0.0
            # Illinois: the end that stays counts half
            fast = np.where(inside, 0.5 * fast, rate)
            high = np.where(inside, high, trial_length)
            slow = np.where(inside, rate, 0.5 * slow)
            low = np.where(inside, trial_length, low)
        values, turns, directions = beyond[0].values.copy(), beyond[0].turns.copy(), beyond[1].copy()
        values[:, index], turns[..., index], directions[:, index] = solution.values, solution.turns, direction
        lengths = length.copy()
        lengths[index] = trial_length
        return Coordinates(values, turns), directions, lengths

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
        start = swings.curves[1].values[0, self.crank, indices]
        d, p = angles.shape
        first = swings.curves[1]
        values = np.empty((first.values.shape[1], d, p))
        rotations = np.empty((*first.turns.shape[1:4], d, p))
        for direction, curve in swings.curves.items():
            design, column = np.nonzero((angles >= start[:, None]) == (direction > 0))
            row, angle = indices[design], angles[design, column]
            nodes = curve.values[:, self.crank]
            previous = (direction * nodes[:, row] <= direction * angle).sum(0) - 1
            node = np.clip(previous, 0, curve.last[row] - 1)
            low, high = nodes[node, row], nodes[node + 1, row]
            fraction = (angle - low) / (high - low)
            # near a dead centre the crank angle is a quadratic function of the distance
            ends = 1.0 - np.sqrt(np.maximum(1.0 - fraction, 0.0))
            ahead = np.where(node == curve.last[row] - 1, ends, fraction) * curve.length[node, row]
            q = Coordinates(curve.values[node, :, row].T, np.moveaxis(curve.turns[node, ..., row], 0, -1))
            loops = self._loops(swings.rows[row], len(row))
            q = self._moved(loops, q, curve.tangent[node, :, row].T * ahead)
            values[:, design, column], rotations[..., design, column] = q.values, q.turns
        values, rotations = (array.swapaxes(-1, -2) for array in (values, rotations))
        return Coordinates(values.reshape(len(values), -1), rotations.reshape(*rotations.shape[:3], d * p))


def _select(curve: Curve, which: Bools) -> Curve:
    return Curve(
        curve.values[..., which],
        curve.turns[..., which],
        curve.tangent[..., which],
        curve.length[:, which],
        curve.last[which],
    )
