"""Many designs followed together along the same path of their drivers, each kept in its own assembly.

As one mechanism is followed (`followed_path`): by cells that are foretold by the polynomial of the cell
before, closed at all nodes of all designs together, and taken for a design only where it lies close to what
was foretold, is smooth, and stays on its side of every singular pose. A design for which a cell is not good
goes on in shorter ones; one that needs them very short is left to be followed by itself.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure.followed_path import FIRST, LONGEST, NODES, ROUGH
from mechsim.analytic.closure.loop_solver import FAR, HALF, MOST_STEPS, ROUNDING, LoopSolver, loop_solver
from mechsim.analytic.closure.many_loops import Bools, ManyLoops, Rows
from mechsim.analytic.closure.path_cells import ASTRAY, CLOSED, Cell, PathRows, nodes_between
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.analytic.closure.tree_rates import LONG, SHORT, STEPS, ClosedPart, Instants
from mechsim.maths.arrays import Array

# designs that need cells shorter than this are left to themselves
SHORTEST = 4e-3
# part of the designs that a longer step must suit
SUITS = 0.2
# instants closed in one go
CHUNK = 4096
# takes which designs, which of the angles, and their closed instants
Kept = Callable[[Rows, Rows, ClosedPart], None]
# parameters of a path (n,) -> what is prescribed and its first two derivatives, (driven, n) each
Law = Callable[[Array], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class Group:
    """Designs that are followed with the same cells.

    Attributes:
        rows: which they are, (d,).
        here: how far they were followed.
        step: length of the next cell.
        at: where they are there, (d) sets of coordinates.
        side: sign of the loops' determinant, (d,); 0 where it is not known yet.
        picked: independent rows, by which they are solved.
        gauge: directions that the loops leave open, as of a link's spin, over the unknowns, (open, unknowns).
        nodes: of the last cell; none before the first.
        states: there, (d, nodes, w).
    """

    rows: Rows
    here: float
    step: float
    at: Coordinates
    side: Array
    picked: Rows
    gauge: Array
    nodes: Array
    states: Array

    def some(self, which: Rows | Bools, **changed: object) -> "Group":
        """Return some of the designs."""
        at = Coordinates(self.at.values[:, which], self.at.turns[..., which])
        states = self.states[which] if len(self.nodes) else self.states
        found = replace(self, rows=self.rows[which], at=at, side=self.side[which], states=states)
        return replace(found, **changed)  # pyright: ignore[reportArgumentType]


class ManyPaths:
    """Designs followed along a path of their drivers, as over the angles of their crank.

    Attributes:
        many: their loops.
        law: of what is prescribed along the path.
        begin: parameter at which they begin.
        left: which could not be followed together, so far.
    """

    def __init__(self, many: ManyLoops, law: Law, begin: float):
        self.many, self.law, self.begin = many, law, begin
        self.left: list[Rows] = []

    def follow(self, rows: Rows, at: Coordinates, angles: Array, kept: Kept) -> Rows:
        """Follow designs to parameters of the path; return those that could not be followed together.

        Args:
            rows: which designs of the loops they are, (d,).
            at: where they stand at the beginning, (d) sets of coordinates.
            angles: (p,) in [rad].
            kept: takes what was closed: each of the designs at each of some angles.
        """
        loops = self.many.of(rows[:1], 1)
        first = Coordinates(at.values[:, :1], at.turns[..., :1])
        solver, none = loop_solver(loops, first), np.zeros(0)
        side = np.zeros(len(rows))
        group = Group(rows, self.begin, FIRST, at, side, solver.rows, solver.gauge, none, none)
        for sense in (1.0, -1.0):
            ahead = np.flatnonzero(sense * (angles - self.begin) >= (0.0 if sense > 0 else 1e-300))
            waiting = [group] if len(ahead) else []
            while waiting:
                waiting += self._cell(waiting.pop(), sense, angles, ahead, kept)
        return np.unique(np.concatenate([*self.left, np.zeros(0, dtype=np.intp)]))

    def _cell(self, group: Group, sense: float, angles: Array, ahead: Rows, kept: Kept) -> list[Group]:
        """Follow a group over one cell; return the groups that go on."""
        to = float((sense * angles[ahead]).max()) * sense
        left = sense * (to - group.here)
        if group.step < SHORTEST:
            self.left.append(group.rows)
            return []
        group, others = self._served(group)
        if not len(group.rows):
            return others
        step = left if left <= group.step else min(group.step, 0.6 * left)
        step = max(step, 1e-6)
        nodes, weights = nodes_between(group.here, group.here + sense * step, NODES)
        try:
            states, good, suits, side = self._closed(group, nodes)
        except np.linalg.LinAlgError:
            return [*others, *self._halved(group, step)]
        if not good.all():
            others += self._halved(group.some(~good), step)
            group, states = group.some(good), states[good]
            suits, side = suits[good], side[good]
            if not len(group.rows):
                return others
        end = float(nodes[-1])
        rows = PathRows(self.many.of(group.rows, 1), self._drive)
        at = rows.unflat(states[:, -1], np.full(len(group.rows), end))
        self._evaluate(group, Cell(nodes, states, weights, self._solver(group, 1)), angles, ahead, kept)
        if left <= step + 1e-12:
            return others
        growth = float(np.quantile(suits, SUITS))
        longer = min(LONGEST, growth * step)
        on = replace(group, here=end, step=longer, at=at, side=side, nodes=nodes, states=states)
        return [*others, on]

    def _halved(self, group: Group, step: float) -> list[Group]:
        return [replace(group, step=0.5 * step)] if len(group.rows) else []

    def _drive(self, s: Array) -> Array:
        return self.law(s)[0]

    def _solver(self, group: Group, repeat: int) -> LoopSolver:
        loops = self.many.of(group.rows, repeat)
        pinned = Coordinates(np.repeat(group.at.values, repeat, 1), np.repeat(group.at.turns, repeat, -1))
        return LoopSolver(loops, group.picked, group.gauge, pinned)

    def _served(self, group: Group) -> tuple[Group, list[Group]]:
        """Return the designs whose rows tell enough where they are, and the others with other rows."""
        spins = len(group.gauge) > 0
        if not spins and len(group.picked) == self.many.loops.rows:
            return group, []
        if spins:
            # what is left open turns with the links; it goes on as it was, and so do determinants' signs
            group = replace(group, gauge=self._solver_of_first(group, group.gauge).gauge)
        solver = self._solver(group, 1)
        found = solver.linearise(group.at)
        own = np.linalg.svd(found.matrix, compute_uv=False)[:, -1]
        every = np.linalg.svd(found.slope[:, solver.loops.unknown].transpose(2, 0, 1), compute_uv=False)
        good = own > HALF * every[:, len(group.picked) - 1]
        if good.all():
            return group, []
        rest = group.some(~good)
        fresh = self._solver_of_first(rest)
        same = np.array_equal(fresh.rows, group.picked) and not (spins and good.any())
        if len(fresh.rows) != len(group.picked) or same:
            self.left.append(rest.rows)
            return group.some(good), []
        # determinants of other rows have other signs
        side = np.zeros(len(rest.rows))
        return group.some(good), [replace(rest, picked=fresh.rows, gauge=fresh.gauge, side=side)]

    def _solver_of_first(self, group: Group, before: Array | None = None) -> LoopSolver:
        """Return the solver of a group's first design where it stands."""
        first = group.some(np.arange(1))
        return loop_solver(self.many.of(first.rows, 1), first.at, before)

    def _closed(self, group: Group, nodes: Array) -> tuple[Array, Bools, Array, Array]:
        """Return states (d, nodes, w) closed there, which are good, by how much steps may grow, and sides."""
        count, k = len(group.rows), len(nodes)
        solver = self._solver(group, k)
        path = PathRows(solver.loops, self._drive)
        s = np.tile(nodes, count)
        at = path.unflat(self._foretold(group, nodes).reshape(count * k, -1), s)
        at, residual, gone, matrix = newton(solver, at)
        states = path.flat(at).reshape(count, k, -1)
        shape = (count, k)
        gone, residual = gone.reshape(shape).max(1), residual.reshape(shape).max(1)
        signs = np.linalg.slogdet(matrix)[0].reshape(shape)
        half = nodes_between(0.0, 1.0, k // 2 + 1)[1]
        even = states[:, ::2].transpose(1, 0, 2).reshape(k // 2 + 1, -1)
        told = Cell(nodes[::2], even, half, solver).at(nodes[1::2]).reshape(k // 2, count, -1)
        rough = np.abs(told.transpose(1, 0, 2) - states[:, 1::2]).max((1, 2))
        side = np.where(group.side == 0.0, signs[:, 0], group.side)
        same = (signs == side[:, None]).all(1)
        good = (residual < CLOSED) & (gone < ASTRAY) & (rough <= ROUGH) & same
        twice, some = (rough < 1e-7) & (gone < 1e-3), (rough < 1e-5) & (gone < 1e-2)
        return states, good, np.where(twice, 2.0, np.where(some, 1.4, 1.0)), side

    def _foretold(self, group: Group, nodes: Array) -> Array:
        """Return rough states at nodes, (d, nodes, w): by the cell before, or along the tangent."""
        count, k = len(group.rows), len(nodes)
        if len(group.nodes):
            weights = nodes_between(0.0, 1.0, len(group.nodes))[1]
            table = group.states.transpose(1, 0, 2).reshape(len(group.nodes), -1)
            told = Cell(group.nodes, table, weights, self._solver(group.some(np.arange(1)), 1)).at(nodes)
            return told.reshape(k, count, -1).transpose(1, 0, 2)
        solver = self._solver(group, k)
        loops = solver.loops
        start = Coordinates(np.repeat(group.at.values, k, 1), np.repeat(group.at.turns, k, -1))
        driven = list(loops.driven)
        ahead = np.zeros((loops.tree.count, count * k))
        gone = self._drive(np.tile(nodes, count)) - self._drive(np.array([group.here]))
        ahead[driven] = gone / loops.units[driven, None]
        found = solver.linearise(start)
        opened = np.zeros_like(found.right)
        opened[:, : len(solver.rows)] = np.einsum("rkn,kn->nr", found.slope[solver.rows], ahead)
        moved = loops.moved(start, ahead + solver.step(found.matrix, opened))
        return PathRows(loops, self._drive).flat(moved).reshape(count, k, -1)

    def _evaluate(self, group: Group, cell: Cell, angles: Array, ahead: Rows, kept: Kept) -> None:
        """Close the poses asked for in a cell and hand them on."""
        low, high = sorted((cell.nodes[0], cell.nodes[-1]))
        begun = not len(group.nodes)
        inside = (angles[ahead] > low) & (angles[ahead] <= high)
        if cell.nodes[-1] < cell.nodes[0]:
            inside = (angles[ahead] >= low) & (angles[ahead] < high)
        if begun:
            inside |= angles[ahead] == cell.nodes[0]
        places = ahead[inside]
        step = max(1, CHUNK // max(1, len(places)))
        for first in range(0, len(group.rows) if len(places) else 0, step):
            some = group.some(np.arange(first, min(first + step, len(group.rows))))
            states = cell.states[first : first + step]
            self._poses(some, replace(cell, states=states), angles, places, kept)

    def _poses(self, group: Group, cell: Cell, angles: Array, places: Rows, kept: Kept) -> None:
        count, p = len(group.rows), len(places)
        table = cell.states.transpose(1, 0, 2).reshape(len(cell.nodes), -1)
        told = replace(cell, states=table).at(angles[places]).reshape(p, count, -1).transpose(1, 0, 2)
        solver = self._solver(group, p)
        s = np.tile(angles[places], count)
        at = PathRows(solver.loops, self._drive).unflat(told.reshape(count * p, -1), s)
        found, lost = solver.linearise(at), np.zeros(count * p, dtype=np.bool_)
        for _ in range(STEPS):
            step = solver.step(found.matrix, found.right)
            longest = np.abs(step).max(0)
            lost |= ~(longest < LONG)
            at = solver.loops.moved(at, np.where(lost, 0.0, step))
            found = solver.linearise(at)
            if longest.max(initial=0.0) < SHORT:
                break
        if lost.any():
            self.left.append(group.rows[lost.reshape(count, p).any(1)])
        still, pace = np.zeros_like(s), np.ones_like(s)
        instants = Instants(s, pace, still, *self.law(s))
        kept(group.rows, places, ClosedPart(solver, np.arange(len(s)), instants, at, found))


def newton(solver: LoopSolver, at: Coordinates) -> tuple[Coordinates, Array, Array, Array]:
    """Return coordinates closed, their residuals (n,), how far they moved (n,), and the matrices there."""
    gone, frozen = np.zeros(len(at)), np.zeros(len(at), dtype=np.bool_)
    found = solver.linearise(at)
    worst: NDArray[np.float64] = np.full(len(at), np.inf)
    for _ in range(MOST_STEPS):
        before, worst = worst, np.abs(found.right).max(1, initial=0.0)
        done = frozen | (worst == 0.0) | ((worst < ROUNDING) & (worst > 0.1 * before))
        if done.all():
            break
        step = solver.step(found.matrix, found.right)
        length = np.abs(step).max(0)
        gone += np.where(done, 0.0, length)
        frozen |= ~(length < FAR)
        at = solver.loops.moved(at, np.where(done | frozen, 0.0, step))
        found = solver.linearise(at)
    residual = np.abs(found.residual).max(0, initial=0.0)
    return at, residual, np.where(frozen, np.inf, gone), found.matrix
