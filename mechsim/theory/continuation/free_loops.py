"""The loop equations of a mechanism with its crank left free, made ready to walk along what stays open."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure.loop_solver import LoopSolver
from mechsim.analytic.closure.numerical_rank import significant
from mechsim.analytic.closure.tree_loops import TreeLoops, orthogonal
from mechsim.analytic.closure.tree_motion import Coordinates, LinkPoses
from mechsim.maths.arrays import Array
from mechsim.theory.continuation.marks import Marks, marks_of, of_all, split

# a residual that is closed, and Newton steps on the way to it
CLOSED, MOST_STEPS = 1e-12, 8
# a step, in radians or parts of the size, beyond which the linear model says nothing
FAR = 0.3


@dataclass(frozen=True, slots=True)
class Closed:
    """Closed coordinates at n places of a curve.

    Attributes:
        at: the coordinates.
        marks: (n, 3 k).
        rates: of the marks by the solver's own measure of length, (n, 3 k).
        along: rates of the unknown coordinates in their units, (n, unknowns).
        length: the solver's measure from where it was made, (n,).
        least: singular value that vanishes where assemblies meet, (n,).
        side: sign of the determinant, which changes where two assemblies meet, (n,).
    """

    at: Coordinates
    marks: Array
    rates: Array
    along: Array
    length: Array
    least: Array
    side: Array


@dataclass(frozen=True)
class FreeLoops:
    """A mechanism with one freedom as a curve to walk along.

    Attributes:
        loops: its equations, no driver prescribed.
        held: where the coordinates stand that are held, (holds,) in [m] or [rad].
        rank: how many of them are independent.
        marks: what tells poses apart.
    """

    loops: TreeLoops
    held: Array
    rank: int
    marks: Marks

    def flat(self, at: Coordinates) -> Array:
        """Return coordinates as rows of numbers, (n, w)."""
        values = (at.values / self.loops.units[:, None]).T
        return np.concatenate([values, at.turns.reshape(-1, len(at)).T], 1)

    def unflat(self, rows: Array) -> Coordinates:
        """Return coordinates from rows of numbers nearly right, those that are held to the last bit.

        No row of the loops would bring these back from what polynomials of one cell foretell for the next.
        """
        k = self.loops.tree.count
        values = rows[:, :k].T * self.loops.units[:, None]
        values[[*self.loops.driven]] = self.held[:, None]
        turns = np.ascontiguousarray(rows[:, k:].T).reshape(-1, 3, 3, len(rows))
        if len(turns):
            turns = np.stack([orthogonal(orthogonal(turn)) for turn in turns])
        return Coordinates(values, turns)

    def solver(self, at: Coordinates, along: Array | None) -> LoopSolver:
        """Return a solver about one set of coordinates: its first gauge leads along the curve."""
        from scipy.linalg import qr

        _, slope, here = self.loops.linearise(at)
        slope = slope[:, self.loops.unknown]
        ahead, idle = split(self.loops, here, np.linalg.svd(slope[..., 0])[2][self.rank :])
        if along is not None and ahead @ along < 0.0:
            ahead = -ahead
        rows = np.zeros(0, dtype=np.intp)
        if self.rank:
            pivoted: Any = qr(slope[..., 0].T, mode="economic", pivoting=True)
            rows = np.sort(pivoted[2][: self.rank])
        return LoopSolver(self.loops, rows, np.vstack([ahead, idle]), at)

    def close(self, solver: LoopSolver, guess: Coordinates) -> Closed | None:
        """Return coordinates closed from a guess across the curve; None where Newton's method fails."""
        at, found = guess, solver.linearise(guess)
        length, before = found.rhs[:, self.rank].copy(), np.inf
        for _ in range(MOST_STEPS):
            right = found.rhs.copy()
            right[:, self.rank] -= length
            worst = float(np.abs(right).max())
            if worst <= 1e-15 or (worst < 1e-13 and worst > 0.1 * before):
                break
            before = worst
            try:
                step = solver.step(found.matrix, right)
            except np.linalg.LinAlgError:
                return None
            if not np.abs(step).max() < FAR:
                return None
            at = self.loops.displaced(at, step)
            found = solver.linearise(at)
        if not np.abs(found.residual).max(initial=0.0) < CLOSED:
            return None
        ahead = np.zeros(found.matrix.shape[1])
        ahead[self.rank] = 1.0
        try:
            right = np.broadcast_to(ahead[:, None], (len(at), len(ahead), 1))
            along = np.linalg.solve(found.matrix, right)[..., 0].astype(np.float64, copy=False)
        except np.linalg.LinAlgError:
            return None
        rates = self.marks.rates(found.poses, of_all(self.loops, along))
        least = self.least(found.jacobian)
        side = np.linalg.slogdet(found.matrix)[0]
        return Closed(at, self.marks.at(found.poses), rates, along, length, least, side)

    def least(self, slope: Array) -> Array:
        """Return the singular value of slopes (rows, count, n) that vanishes where assemblies meet, (n,)."""
        if not self.rank:
            return np.ones(slope.shape[2])
        by_unknowns = slope[:, self.loops.unknown].transpose(2, 0, 1)
        values = np.linalg.svd(by_unknowns, compute_uv=False)[:, self.rank - 1]
        return values.astype(np.float64, copy=False)

    def polished(self, solver: LoopSolver, rows: Array, blind: NDArray[np.bool_]) -> LinkPoses:
        """Return poses closed to rounding from rows that nearly are; blind ones stay as they are."""
        at = self.unflat(rows)
        found = solver.linearise(at)
        for _ in range(2):
            right = np.where(blind[:, None], 0.0, found.rhs)
            right[:, self.rank :] = 0.0
            matrix = np.where(blind[:, None, None], np.eye(found.matrix.shape[1]), found.matrix)
            at = self.loops.displaced(at, solver.step(matrix, right))
            found = solver.linearise(at)
        return found.poses

    def meeting(self, rows: Callable[[Array], Array], low: float, high: float) -> tuple[float, float, float]:
        """Return where between two arcs assemblies are nearest to meeting.

        Args:
            rows: arc (n,) -> flattened coordinates.
            low: arc at one end.
            high: arc at the other.

        Returns:
            The arc, the singular value that vanishes where they meet, and how far the loops stand open
            there in the direction in which they then cannot be closed.
        """
        best = 0.5 * (low + high)
        left, right = low, high
        for _ in range(11):
            arcs = np.linspace(left, right, 25)
            slope = self.loops.linearise(self.unflat(rows(arcs)))[1]
            i = int(np.argmin(self.least(slope)))
            best = float(arcs[i])
            left, right = float(arcs[max(i - 2, 0)]), float(arcs[min(i + 2, 24)])
        residual, slope, _ = self.loops.linearise(self.unflat(rows(np.array([best]))))
        u, values, _ = np.linalg.svd(slope[:, self.loops.unknown, 0])
        return best, float(values[self.rank - 1]), float(abs(u[:, self.rank - 1] @ residual[:, 0]))


def free_loops(loops: TreeLoops, at: Coordinates) -> FreeLoops:
    """Return loops whose drivers are free, about one set of closed coordinates, ready to walk along.

    Raises:
        MobilityError: where not exactly one freedom is open there, beside idle ones.
    """
    _, slope, here = loops.linearise(at)
    _, values, right = np.linalg.svd(slope[:, loops.unknown, 0])
    rank = int(significant(values).sum())
    _, idle = split(loops, here, right[rank:])
    return FreeLoops(
        loops, at.values[[*loops.driven], 0], rank, marks_of(loops.tree, here, of_all(loops, idle))
    )
