"""Solving linearised loops for many instants at once: independent rows, and a gauge for what is left open."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure.telling import RANK_TOLERANCE, telling
from mechsim.analytic.closure.tree_layout import Some, block
from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import Coordinates, Placed, product
from mechsim.maths.arrays import Array

# Newton steps taken at the most, and a residual that is rounding
MOST_STEPS, ROUNDING = 8, 1e-13
# slopes below this are rounding
IDLE = 1e-14
# steps, in radians or units of the size, that are too long for the linear model
FAR = 0.3
# part of the best that rows and gauge may tell before others are picked, by singular value and determinant;
# and part of what they told elsewhere below which they are singular themselves, not the pose
HALF, TELLING, FEW = 0.4, 0.5, 0.2


@dataclass(frozen=True)
class Linearised:
    """The loops about n sets of coordinates.

    Attributes:
        residual: of all rows, (rows, n).
        slope: by all coordinates in their units, (rows, count, n).
        here: where the links are.
        matrix: of independent rows and gauge by the unknowns, (n, u, u).
        right: what the same rows stand open by, (n, u).
        unknown: which coordinates these are, (u,).
        others: indices of the rows that are not solved.
    """

    residual: Array
    slope: Array
    here: Placed
    matrix: Array
    right: Array
    unknown: NDArray[np.intp]
    others: NDArray[np.intp]

    @cached_property
    def values(self) -> Array:
        """Singular values of the matrices, (n, u)."""
        return np.asarray(np.linalg.svd(self.matrix, compute_uv=False), dtype=np.float64)

    @cached_property
    def every(self) -> Array:
        """Singular values of all rows by the unknowns, (n, the fewer of them)."""
        slope = self.slope.take(self.unknown, 1)
        if len(self.others) + self.matrix.shape[1] == len(slope) and self._idle(slope):
            return self.values
        return np.asarray(np.linalg.svd(slope.transpose(2, 0, 1), compute_uv=False), dtype=np.float64)

    def _idle(self, slope: Array) -> bool:
        """Say whether the rows that are not solved tell nothing, as those off a flat linkage's plane."""
        return bool(np.abs(slope.take(self.others, 0)).max(initial=0.0) < IDLE)

    @cached_property
    def side(self) -> Array:
        """The signed distance from a singular pose, (n,): two assemblies that meet differ in sign."""
        if not self.matrix.size:  # the drivers alone say where everything is
            return np.ones(len(self.matrix))
        return self._determinant[0] * self.values[:, -1]

    @property
    def size(self) -> Array:
        """The logarithm of the determinants' size, (n,)."""
        return self._determinant[1]

    @cached_property
    def _determinant(self) -> tuple[Array, Array]:
        """Signs, and logarithms of sizes, (n,) each."""
        sign, size = np.linalg.slogdet(self.matrix)
        return sign, size


@dataclass(frozen=True)
class LoopSolver:
    """Which rows are solved, and what keeps the freedoms they leave open.

    Attributes:
        loops: the equations.
        rows: indices of independent rows, (r,).
        gauge: directions of the open freedoms over the unknowns, (open, unknowns).
        pinned: coordinates from which nothing moves along them, one set.
    """

    loops: TreeLoops
    rows: NDArray[np.intp]
    gauge: Array
    pinned: Coordinates

    @cached_property
    def picked(self) -> tuple[Some, ...]:
        """Of all slopes, those of the rows that are solved by the unknowns."""
        return block(self.rows, self.loops.unknown)

    @cached_property
    def others(self) -> NDArray[np.intp]:
        """Indices of the rows that are not solved."""
        return np.delete(np.arange(self.loops.rows), self.rows)

    @cached_property
    def there(self) -> Linearised:
        """The loops about the pinned coordinates."""
        return self.linearise(self.pinned)

    @property
    def open(self) -> int:
        """Freedoms that neither drivers nor loops determine."""
        return len(self.gauge)

    @property
    def whole(self) -> bool:
        """Whether all rows are solved and determine all there is."""
        return not self.open and len(self.rows) == self.loops.rows

    def telling(self, found: Linearised) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return at which poses it tells about as much as all rows do, (n,) each.

        In the direction that is held least; and by the determinant, of which no choice of rows has more.
        """
        if self._alone(found):
            everywhere = np.ones(len(found.matrix), dtype=np.bool_)
            return everywhere, everywhere
        every = found.every[:, : len(self.rows)]
        least = found.values[:, -1] > HALF * every[:, -1]
        return least, found.values.prod(1) > TELLING * every.prod(1)

    def _alone(self, found: Linearised) -> bool:
        """Say whether no other rows tell anything there, or none do."""
        return self.whole or not len(self.rows) or found.every is found.values

    def share(self, found: Linearised) -> Array:
        """Return how much of what all rows tell it does where held least, (n,); 1 where none tell."""
        if self._alone(found):
            return np.ones(len(found.matrix))
        every = found.every[:, len(self.rows) - 1]
        known = every > RANK_TOLERANCE * every.max()
        return np.where(known, found.values[:, -1] / np.where(known, every, 1.0), 1.0)

    def linearise(self, at: Coordinates) -> Linearised:
        """Return the loops about n sets of coordinates."""
        residual, slope, here = self.loops.linearise(at)
        n, u, r = len(at), len(self.loops.unknown), len(self.rows)
        matrix, right = np.empty((n, u, u), slope.dtype), np.empty((n, u), slope.dtype)
        matrix[:, :r] = slope[self.picked].transpose(2, 0, 1)
        right[:, :r] = residual[self.rows].T
        if self.open:
            self._pin(at, matrix[:, r:], right[:, r:])
        return Linearised(residual, slope, here, matrix, right, self.loops.unknown, self.others)

    def _pin(self, at: Coordinates, rows: Array, gap: Array) -> None:
        """Fill in the gauge: how far coordinates lie from the pinned ones along the open freedoms."""
        loops = self.loops
        away = ((at.values - self.pinned.values) / loops.units[:, None])[loops.unknown]
        gap[:] = (self.gauge @ away).T
        rows[:] = self.gauge
        for ball, turn, pinned in zip(loops.tree.balls, at.turns, self.pinned.turns, strict=True):
            columns = np.searchsorted(loops.unknown, ball.turning) + np.arange(3)
            turned = product(turn, np.broadcast_to(pinned, turn.shape).transpose(1, 0, 2))
            vector = 0.5 * (turned - turned.transpose(1, 0, 2))[[2, 0, 1], [1, 2, 0]]
            gap += (self.gauge[:, columns] @ vector).T
            trace = np.einsum("iin->n", turned)
            change = 0.5 * (trace * np.eye(3)[..., None] - turned)
            rows[..., columns] = np.einsum("pi,ijn->npj", self.gauge[:, columns], change)

    def step(self, matrix: Array, right: Array) -> Array:
        """Return the step of all coordinates, (count, n), that closes rows open by `right`, (n, u)."""
        out = np.zeros((self.loops.tree.count, len(right)), right.dtype)
        out[self.loops.unknown] = -np.linalg.solve(matrix, right[..., None])[..., 0].T
        return out

    def close(
        self, guess: Coordinates, enough: float = 0.0, most: float = FAR
    ) -> tuple[Coordinates, Linearised, Array]:
        """Return coordinates closed by Newton's method from a guess near them; not all need be closed.

        And the loops there, and how far they lie from the guess, (n,). They then stand open by rounding,
        or by no more than `enough`; the loops may then be those before a last step so short that it closes
        them, with what it leaves open. What goes farther than `most` is given up.

        Raises:
            LinAlgError: at a singular pose.
        """
        at, gone = guess, np.zeros(len(guess))
        found = self.linearise(at)
        worst = np.inf
        for _ in range(MOST_STEPS):
            before, worst = worst, float(np.abs(found.right).max(initial=0.0))
            if worst <= enough or (worst < ROUNDING and worst > 0.1 * before):
                break
            step = self.step(found.matrix, found.right)
            size = np.abs(step)
            gone += size.max(0)
            if not gone.max() < most:
                break
            at = self.loops.moved(at, step)
            # turns bend by half the square of a step: it leaves no more open than that
            if float(size.sum(0).max()) ** 2 < enough:
                left = found.residual + np.einsum("rkn,kn->rn", found.slope, step)
                return at, replace(found, residual=left), gone
            found = self.linearise(at)
        return at, found, gone


def loop_solver(
    loops: TreeLoops, at: Coordinates, before: Array | None = None, slope: Array | None = None
) -> LoopSolver:
    """Return the solver for poses near one.

    Args:
        loops: the equations.
        at: one set of closed coordinates, where nothing that the solver must tell is singular.
        before: the gauge so far, which the new one follows.
        slope: of all rows there, (rows, count, 1), where it is known.
    """
    from scipy.linalg import qr

    matrix = (loops.linearise(at)[1] if slope is None else slope)[:, loops.unknown, 0]
    if not matrix.size:
        return LoopSolver(loops, np.zeros(0, dtype=np.intp), np.eye(len(loops.unknown)), at)
    _, values, right = np.linalg.svd(matrix)
    rank = int(telling(values).sum())
    pivoted: Any = qr(matrix.T, mode="economic", pivoting=True)
    order: NDArray[np.intp] = pivoted[2]
    gauge = right[rank:]
    if before is not None and before.shape == gauge.shape:
        left, _, turn = np.linalg.svd(before @ gauge.T)
        gauge = left @ turn @ gauge
    return LoopSolver(loops, np.sort(order[:rank]), gauge, at)
