"""Reachable crank ranges of many designs at once, and their motions within them.

The assembly of every design is traced from its start in both directions by pseudo-arclength continuation with
the crank free: predictor along the tangent of the solution curve, corrector of least norm. The crank turns
back where its component of the tangent changes sign; this dead centre is then located by secant steps.

Source: E. L. Allgower, K. Georg, Introduction to numerical continuation methods, SIAM (2003), chapters 2, 9.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mechsim.analytic.closure.loop_solver import LoopSolver
from mechsim.analytic.closure.many_loops import Bools, ManyLoops, Rows, put_together, rough_coordinates
from mechsim.analytic.closure.many_motion import LikeLoops, LinkRows, keep_part, record_of_rows
from mechsim.analytic.closure.many_paths import newton
from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.analytic.closure.tree_rates import ClosedPart, Instants
from mechsim.maths.angles import TURN
from mechsim.maths.arrays import Array
from mechsim.model.design_arrays import StartedDesigns
from mechsim.model.motion import Motion

# arc length of a step in [rad] and parts of the size, and steps in one direction
STEP, MOST_STEPS = 0.1, 400
# how often a step that fails is halved
HALVINGS = 4
# corrector iterations, residual of a closed loop, and largest corrector displacement, as a part of the step
ITERATIONS, CLOSED, ASTRAY = 5, 1e-12, 0.3
# smallest singular value, as a part of the largest, of loops whose solution is a curve: at a branch point and
# with undetermined degrees of freedom it vanishes
REGULAR = 1e-6
# secant steps to a dead centre, and its tangent's crank component
SECANTS, LEVEL = 12, 1e-9
# largest displacement from a predicted pose to the closed one, in [rad] and parts of the size
NEAR = 0.05
# instants closed at once
CHUNK = 4096


@dataclass(frozen=True)
class Curve:
    """Solution curves of d designs from their starts in one direction, up to their dead centres.

    Attributes:
        values: coordinates at the nodes, (k, count, d).
        turns: of balls, (k, balls, 3, 3, d).
        tangent: unit tangents, (k, free, d).
        length: arc length from each node to the next, (k, d); the last one is not used.
        last: number of each design's last node, its dead centre, (d,).
    """

    values: Array
    turns: Array
    tangent: Array
    length: Array
    last: Rows


@dataclass(frozen=True)
class Swings:
    """Designs whose cranks swing: which they are, and their reachable ranges.

    Attributes:
        rows: which of the designs, (d,).
        low: crank angle of the lower dead centre, (d,) in [rad].
        high: of the upper one.
        curves: direction (-1, 1) -> their solution curves.
    """

    rows: Rows
    low: Array
    high: Array
    curves: dict[int, Curve]


class SwingTracer:
    """Traces designs that are alike; see `can_be_followed_together`."""

    def __init__(self, like: LikeLoops, started: StartedDesigns):
        self.like, self.started = like, started
        loops = like.solver.loops
        self.many = ManyLoops(loops, started.arrays)
        self.crank = loops.driven[0]
        self.free = np.append(loops.unknown, self.crank)

    def swings(self) -> Swings | None:
        """Return the designs whose cranks swing; None where none does or designs cannot be traced."""
        solver = self.like.solver
        if len(solver.gauge) or len(solver.rows) != len(solver.loops.unknown):
            return None
        rough, winds = rough_coordinates(self.many, self.started)
        at, closed = put_together(self.many, rough, len(solver.rows))
        rows = np.flatnonzero(winds & closed)
        curves: dict[int, Curve] = {}
        for sense in (1, -1):
            if not len(rows):
                return None
            start = Coordinates(at.values[:, rows], at.turns[..., rows])
            curves[sense], good = self._traced(rows, start, sense)
            rows, curves = rows[good], {key: _some(curve, good) for key, curve in curves.items()}
        if not len(rows):
            return None
        low, high = (self._end(curves[sense]) for sense in (-1, 1))
        return Swings(rows, low, high, curves)

    def _end(self, curve: Curve) -> Array:
        return curve.values[curve.last, self.crank, np.arange(len(curve.last))]

    def _matrix(self, rows: Rows, at: Coordinates, repeat: int = 1) -> tuple[Array, Array]:
        """Return residuals (n, rows) and Jacobians by the free coordinates (n, rows, free)."""
        residual, slope, _ = self.many.of(rows, repeat).linearise(at)
        return residual.T, slope[:, self.free].transpose(2, 0, 1)

    def _corrected(
        self, rows: Rows, at: Coordinates, repeat: int = 1
    ) -> tuple[Coordinates, Array, Array, Bools]:
        """Return points on the curves, their tangents (free, n), displacements (n,), and which are valid."""
        loops, moved, rank = self.many.of(rows, repeat), np.zeros(len(at)), len(self.free) - 1
        residual, matrix = self._matrix(rows, at, repeat)
        left, values, right = np.linalg.svd(matrix, full_matrices=True)
        for _ in range(ITERATIONS):
            if (np.abs(residual).max(1) < CLOSED).all():
                break
            asked = np.einsum("nrk,nr->nk", left[..., :rank], residual) / np.maximum(values[:, :rank], 1e-300)
            step = -np.einsum("nku,nk->un", right[:, :rank], asked)
            moved += np.abs(step).max(0)
            at = self._moved(loops, at, step)
            residual, matrix = self._matrix(rows, at, repeat)
            left, values, right = np.linalg.svd(matrix, full_matrices=True)
        valid = (np.abs(residual).max(1) < CLOSED) & (values[:, rank - 1] > REGULAR * values[:, 0])
        return at, right[:, -1].T, moved, valid

    def _moved(self, loops: TreeLoops, at: Coordinates, step: Array) -> Coordinates:
        whole = np.zeros((len(at.values), step.shape[1]))
        # no more than a finite step: what goes astray is rejected by its displacement
        whole[self.free] = np.clip(np.nan_to_num(step), -1.0, 1.0)
        return loops.moved(at, whole)

    def _traced(self, rows: Rows, at: Coordinates, sense: int) -> tuple[Curve, Bools]:
        """Return the curves in one direction of the crank, and which of the designs swing back."""
        d = len(rows)
        at, tangent, _, good = self._corrected(rows, at)
        tangent = tangent * np.sign(sense * tangent[-1])
        begin = at.values[self.crank].copy()
        nodes, length = [(at.values, at.turns, tangent)], np.full(d, STEP)
        lengths: list[Array] = []
        last, going = np.zeros(d, dtype=np.intp), good.copy()
        for count in range(1, MOST_STEPS):
            if not going.any():
                break
            here, ahead = nodes[-1], length
            next_at, next_tangent, fine = self._stepped(rows, Coordinates(here[0], here[1]), here[2], ahead)
            for _ in range(HALVINGS):
                if not (going & ~fine).any():
                    break
                ahead = np.where(fine, ahead, 0.5 * ahead)
                next_at, next_tangent, fine = self._stepped(
                    rows, Coordinates(here[0], here[1]), here[2], ahead
                )
            good &= ~going | fine
            going &= fine
            turned = going & (sense * next_tangent[-1] < 0.0)
            if turned.any():
                part = Coordinates(here[0], here[1])
                next_at, next_tangent, ahead = self._dead_centres(
                    rows, part, here[2], ahead, turned, (next_at, next_tangent), sense
                )
            values = np.where(going, next_at.values, here[0])
            turns = np.where(going, next_at.turns, here[1])
            nodes.append((values, turns, np.where(going, next_tangent, here[2])))
            lengths.append(ahead)
            last = np.where(going, count, last)
            gone = going & (np.abs(values[self.crank] - begin) > TURN)
            good &= ~gone
            going &= ~(turned | gone)
            length = np.minimum(STEP, 1.5 * ahead)
        good &= ~going
        lengths.append(np.zeros(d))
        parts = [np.stack([node[i] for node in nodes]) for i in range(3)]
        return Curve(parts[0], parts[1], parts[2], np.stack(lengths), last), good

    def _stepped(
        self, rows: Rows, at: Coordinates, tangent: Array, length: Array
    ) -> tuple[Coordinates, Array, Bools]:
        """Return points a step along the curves, tangents there, and which were reached safely."""
        predicted = self._moved(self.many.of(rows, 1), at, tangent * length)
        found, ahead, moved, valid = self._corrected(rows, predicted)
        ahead = ahead * np.sign((ahead * tangent).sum(0))
        straight = (ahead * tangent).sum(0) > 0.9
        return found, ahead, valid & (moved < ASTRAY * length) & straight

    def _dead_centres(
        self,
        rows: Rows,
        at: Coordinates,
        tangent: Array,
        length: Array,
        which: Bools,
        beyond: tuple[Coordinates, Array],
        sense: int,
    ) -> tuple[Coordinates, Array, Array]:
        """Return the next points of the curves, where some pass a dead centre that dead centre."""
        index = np.flatnonzero(which)
        own = Coordinates(at.values[:, index], at.turns[..., index])
        along, at_zero, at_end = tangent[:, index], tangent[-1, index], beyond[1][-1, index]
        low, high, slow, fast = np.zeros(len(index)), length[index].copy(), at_zero.copy(), at_end.copy()
        found, towards, ahead = own, along, low
        for _ in range(SECANTS):
            ahead = low + (high - low) * slow / (slow - fast)
            found, towards, _ = self._stepped(rows[index], own, along, ahead)
            rate = towards[-1]
            if (np.abs(rate) < LEVEL).all():
                break
            inside = sense * rate > 0.0
            # Illinois: the end that stays counts half
            fast = np.where(inside, 0.5 * fast, rate)
            high = np.where(inside, high, ahead)
            slow = np.where(inside, rate, 0.5 * slow)
            low = np.where(inside, ahead, low)
        values, turns, directions = beyond[0].values.copy(), beyond[0].turns.copy(), beyond[1].copy()
        values[:, index], turns[..., index], directions[:, index] = found.values, found.turns, towards
        lengths = length.copy()
        lengths[index] = ahead
        return Coordinates(values, turns), directions, lengths

    def motion(
        self,
        swings: Swings,
        angles: Array,
        speed: Array,
        acceleration: Array,
        joints: Sequence[str],
        *,
        rates: bool,
    ) -> tuple[Motion, Bools]:
        """Return the motions of designs along crank motions (d, p), and of which they are known, (d,)."""
        d, p = angles.shape
        loops, tree = self.like.solver.loops, self.like.solver.loops.tree
        links = len(tree.branches)
        shapes = [(tree.count,)] * 3 + [(links, 3), (links, 3, 3), (links, 6), (links, 6)]
        found = LinkRows(*(np.zeros((*shape, d, p)) for shape in shapes))
        good = np.ones(d, dtype=np.bool_)
        each = max(1, CHUNK // p)
        for first in range(0, d, each):
            some = np.arange(first, min(first + each, d))
            at = self._predicted(swings, some, angles[some])
            rows, asked = swings.rows[some], angles[some].ravel()
            at, _, _, valid = self._corrected(rows, at, p)
            at.values[self.crank] = asked
            solver = LoopSolver(self.many.of(rows, p), self.like.solver.rows, self.like.solver.gauge, at)
            at, residual, gone, _ = newton(solver, at)
            fine = valid & (residual < CLOSED) & (gone < NEAR)
            good[some] = fine.reshape(-1, p).all(1)
            still = np.zeros_like(asked)
            instants = Instants(asked, np.ones_like(asked), still, *self.like.law(asked))
            part = ClosedPart(solver, np.arange(len(asked)), instants, at, solver.linearise(at))
            keep_part(found, some, np.arange(p), part, rates=rates)
        own = ManyLoops(loops, self.started.arrays.some(swings.rows))
        return record_of_rows(own, found, angles, speed, acceleration, joints), good

    def _predicted(self, swings: Swings, some: Rows, angles: Array) -> Coordinates:
        """Return coordinates near those at crank angles (d, p) of some of the designs, d p sets."""
        start = swings.curves[1].values[0, self.crank, some]
        d, p = angles.shape
        first = swings.curves[1]
        values = np.empty((first.values.shape[1], d, p))
        turns = np.empty((*first.turns.shape[1:4], d, p))
        for sense, curve in swings.curves.items():
            design, place = np.nonzero((angles >= start[:, None]) == (sense > 0))
            own, asked = some[design], angles[design, place]
            nodes = curve.values[:, self.crank]
            before = (sense * nodes[:, own] <= sense * asked).sum(0) - 1
            node = np.clip(before, 0, curve.last[own] - 1)
            low, high = nodes[node, own], nodes[node + 1, own]
            fraction = (asked - low) / (high - low)
            # the crank angle goes with the square of the distance from a dead centre
            ends = 1.0 - np.sqrt(np.maximum(1.0 - fraction, 0.0))
            ahead = np.where(node == curve.last[own] - 1, ends, fraction) * curve.length[node, own]
            at = Coordinates(curve.values[node, :, own].T, np.moveaxis(curve.turns[node, ..., own], 0, -1))
            loops = self.many.of(swings.rows[own], 1)
            at = self._moved(loops, at, curve.tangent[node, :, own].T * ahead)
            values[:, design, place], turns[..., design, place] = at.values, at.turns
        return Coordinates(values.reshape(len(values), -1), turns.reshape(*turns.shape[:3], d * p))


def _some(curve: Curve, which: Bools) -> Curve:
    return Curve(
        curve.values[..., which],
        curve.turns[..., which],
        curve.tangent[..., which],
        curve.length[:, which],
        curve.last[which],
    )
