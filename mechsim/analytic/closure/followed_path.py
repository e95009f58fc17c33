"""The motion of an assembly as its drivers move: cells of closed poses joined by polynomials.

The assembly is kept by smoothness: each cell of the path is foretold by the polynomial of the one
before, closed at all its nodes together, and taken only where it lies close to what was foretold, is
itself smooth, and stays on its side of every singular pose. Where the side changes along a smooth path,
two assemblies meet: the path is then followed up to that change point, which is measured, and through it.
"""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure.loop_solver import Linearised, LoopSolver, loop_solver
from mechsim.analytic.closure.tree_loops import TreeLoops, orthogonal
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.errors import AssemblyError
from mechsim.maths.arrays import Array

# path parameter (n,) -> prescribed coordinates in their units, (driven, n)
Drive = Callable[[Array], Array]

# nodes of a cell, its first length and its longest, in radians of the drivers' motion
NODES, FIRST, LONGEST = 9, 0.1, 1.2
# a cell shorter than this ends at a singular pose
SHORTEST = 1e-13
# farther from what was foretold than this, in radians or parts of the size, may be another assembly; and
# so much of a cell that its even nodes do not tell of the odd ones is not smooth
ASTRAY, ROUGH = 5e-2, 1e-4
# a residual up to which nodes are closed
CLOSED = 1e-12
# half the length of a cell about a change point, its nodes, and how near to it poses are read off the
# polynomial, for there the loops tell nothing
ABOUT, MANY, BLIND = 0.1, 18, 5e-3
# no node of a cell lies so near to a change point, where the loops hardly hold it
CLEAR = 2e-3
# how far beyond what was asked a path is followed: no round number, where change points like to lie
BEYOND = 0.2137
# distances from a change point at which its side is measured: far, and nearest
FAR, NEAR = 1e-3, 3e-7


@dataclass(frozen=True)
class Cell:
    """A stretch of the path: closed coordinates at nodes, and the polynomial through them.

    Attributes:
        nodes: parameters, (k,).
        states: flattened coordinates, (k, w).
        weights: barycentric, (k,).
        solver: what its poses are solved with.
    """

    nodes: Array
    states: Array
    weights: Array
    solver: LoopSolver

    def at(self, s: Array) -> Array:
        """Return the polynomial at parameters (n,), (n, w)."""
        gap = s[:, None] - self.nodes
        hit = gap == 0.0
        part = np.where(hit.any(1)[:, None], hit, self.weights / np.where(hit, 1.0, gap))
        return (part / part.sum(1, keepdims=True)) @ self.states

    def derivative(self) -> "Cell":
        """Return the polynomial's derivative, through the same nodes."""
        gap = self.nodes[:, None] - self.nodes
        np.fill_diagonal(gap, 1.0)
        matrix = self.weights / self.weights[:, None] / gap
        np.fill_diagonal(matrix, 0.0)
        np.fill_diagonal(matrix, -matrix.sum(1))
        return replace(self, states=matrix @ self.states)


def nodes_between(low: float, high: float, count: int) -> tuple[Array, Array]:
    """Return Chebyshev points of the second kind from one end to the other, and barycentric weights."""
    nodes = 0.5 * (low + high) + 0.5 * (low - high) * np.cos(np.pi * np.arange(count) / (count - 1))
    weights = np.where(np.arange(count) % 2, -1.0, 1.0)
    weights[[0, -1]] *= 0.5
    nodes[[0, -1]] = low, high
    return nodes, weights


class FollowedPath:
    """An assembly followed along a path of its drivers, as far as was asked.

    Attributes:
        loops: of the mechanism.
        meetings: parameters at which two assemblies meet, as they were passed.
    """

    def __init__(self, loops: TreeLoops, drive: Drive, start: Coordinates, at: float):
        self.loops, self.drive, self.start, self.begin = loops, drive, start, at
        self.cells: dict[int, list[Cell]] = {1: [], -1: []}
        self.meetings: list[float] = []

    def flat(self, at: Coordinates) -> Array:
        """Return coordinates as rows of numbers, (n, w)."""
        values = (at.values / self.loops.units[:, None]).T
        return np.concatenate([values, at.turns.reshape(-1, len(at)).T], 1)

    def unflat(self, rows: Array, s: Array) -> Coordinates:
        """Return coordinates from rows of numbers nearly right, at parameters (n,)."""
        k = self.loops.tree.count
        turns = np.ascontiguousarray(rows[:, k:].T).reshape(-1, 3, 3, len(rows))
        if len(turns):
            turns = np.stack([orthogonal(orthogonal(turn)) for turn in turns])
        values = rows[:, :k].T * self.loops.units[:, None]
        values[list(self.loops.driven)] = self.drive(s)
        return Coordinates(values, turns)

    def extend(self, to: float) -> None:
        """Follow the assembly as far as a parameter, and a little beyond where it goes on.

        A change point is known for one only from beyond.

        Raises:
            AssemblyError: at the parameter beyond which the loops cannot close in this assembly.
        """
        sense = 1 if to > self.begin else -1
        with suppress(AssemblyError):
            self._reach(to + sense * BEYOND, sense)
            return
        self._reach(to, sense)

    def _reach(self, to: float, sense: int) -> None:
        done = self.cells[sense]
        here = float(done[-1].nodes[-1]) if done else self.begin
        length = abs(done[-1].nodes[-1] - done[-1].nodes[0]) if done else FIRST
        while sense * (to - here) > 0.0:
            left = sense * (to - here)
            step = left if left <= length else min(length, 0.6 * left)
            cell, length = self._next(here, sense, step)
            if cell is not None:
                done.append(cell)
            elif length < SHORTEST:
                raise AssemblyError(
                    f"{self.loops.tree.mechanism.name}: the crank cannot pass {here:.7g} rad in this "
                    "assembly; stay on this side of the dead centre or change the dimensions"
                )
            here = float(done[-1].nodes[-1]) if done else self.begin

    def _next(self, here: float, sense: int, step: float) -> tuple[Cell | None, float]:
        """Return the next cell, None where a shorter one must be tried, and the length to try next."""
        solver = self._solver(here, sense)
        nodes, weights = nodes_between(here, here + sense * step, NODES)
        found = self._closed(solver, nodes, self._foretold(here, sense, solver, nodes))
        if found is None:
            return None, 0.5 * step
        states, loops, moved = found
        cell = Cell(nodes, states, weights, solver)
        side = loops.side()
        rough = self._roughness(cell)
        if rough > ROUGH:
            return None, 0.5 * step
        flips = np.flatnonzero(np.sign(side[1:]) != np.sign(side[:-1]))
        if len(flips):
            return self._through(cell, side, int(flips[0]), sense, step)
        growth = 2.0 if rough < 1e-7 and moved < 1e-3 else 1.4 if rough < 1e-5 and moved < 1e-2 else 1.0
        return cell, min(LONGEST, growth * step)

    def _roughness(self, cell: Cell) -> float:
        half = Cell(
            cell.nodes[::2], cell.states[::2], nodes_between(0.0, 1.0, NODES // 2 + 1)[1], cell.solver
        )
        return float(np.abs(half.at(cell.nodes[1::2]) - cell.states[1::2]).max())

    def _through(
        self, cell: Cell, side: Array, flip: int, sense: int, step: float
    ) -> tuple[Cell | None, float]:
        """Return the cell through a change point, or the length of the cell that ends before it.

        Where it is none, but a sharp bend of the path or its end, shorter cells will show.
        """
        a, b = cell.nodes[flip : flip + 2]
        meeting = self._meeting(cell, float(a), float(b))
        if meeting is None:
            return None, 0.5 * step
        here = float(cell.nodes[0])
        if sense * (meeting - here) > 1.5 * ABOUT:
            return None, sense * (meeting - here) - ABOUT
        if sense * (meeting - here) < CLEAR:
            return None, self._back(meeting, sense)
        beyond, count = meeting + sense * ABOUT, MANY
        nodes, weights = nodes_between(here, beyond, count)
        while np.abs(nodes - meeting).min() < CLEAR:
            count += 1
            nodes, weights = nodes_between(here, beyond, count)
        found = self._closed(cell.solver, nodes, cell.at(nodes))
        if found is None:
            return None, 0.5 * step
        self.meetings.append(meeting)
        return Cell(nodes, found[0], weights, cell.solver), ABOUT

    def _back(self, meeting: float, sense: int) -> float:
        """Take back the cell that ends in a change point, and return the length of a shorter one.

        Raises:
            AssemblyError: where there is none, and the path begins there.
        """
        if not self.cells[sense]:
            raise AssemblyError(
                f"{self.loops.tree.mechanism.name}: the start lies {abs(meeting - self.begin):.3g} rad from "
                f"crank angle {meeting:.7g} rad, where two assemblies meet and none can be told from the "
                "other; start at another crank angle"
            )
        taken = self.cells[sense].pop()
        return 0.6 * abs(float(taken.nodes[-1] - taken.nodes[0]))

    def _meeting(self, cell: Cell, a: float, b: float) -> float | None:
        """Return where two assemblies meet between two nodes; None where they only come near each other."""

        def sides(s: Array) -> Array | None:
            found = self._closed(cell.solver, s, cell.at(s))
            return None if found is None else found[1].side()

        ends = sides(np.array([a, b])) if abs(b - a) > NEAR else None
        if ends is None:
            return None
        at = a - ends[0] * (b - a) / (ends[1] - ends[0])
        for apart in (min(0.1 * abs(b - a), FAR), 0.03 * FAR):
            # a parabola through three points on either side of where the root is thought to be
            around = at + apart * np.array([-2.0, -1.0, 1.0, 2.0])
            found = sides(around)
            if found is None or not np.all(np.sign(found[[0, 1]]) == -np.sign(found[[2, 3]])):
                return None
            parabola = np.polynomial.Polynomial.fit((around - at) / apart, found, 2)
            roots = parabola.roots()
            real = roots[np.abs(roots.imag) < 1e-12].real
            if not len(real):
                return None
            rate = float(parabola.deriv()(0.0)) / apart
            at += apart * float(real[np.argmin(np.abs(real))])
        near = at + NEAR * np.array([-2.0, -1.0, 1.0, 2.0])
        found = sides(near)
        if found is None:
            return None
        meant = rate * (near - at)
        return at if np.abs(found - meant).max() < 0.2 * abs(rate) * NEAR else None

    def _closed(self, solver: LoopSolver, s: Array, rows: Array) -> tuple[Array, Linearised, float] | None:
        """Return states closed from rough ones, the loops there, and how far they moved; or None."""
        try:
            at, found, moved = solver.close(self.unflat(rows, s))
        except np.linalg.LinAlgError:
            return None
        if not (np.abs(found.residual).max(initial=0.0) < CLOSED and moved.max() < ASTRAY):
            return None
        return self.flat(at), found, float(moved.max())

    def _solver(self, here: float, sense: int) -> LoopSolver:
        done = self.cells[sense] or self.cells[-sense]
        if not done:
            return loop_solver(self.loops, self.start)
        cell = done[-1] if self.cells[sense] else done[0]
        state = cell.states[-1:] if self.cells[sense] else cell.states[:1]
        at = self.unflat(state, np.array([here]))
        if cell.solver.serves(at):
            return cell.solver
        return loop_solver(self.loops, at, cell.solver.gauge)

    def _foretold(self, here: float, sense: int, solver: LoopSolver, s: Array) -> Array:
        """Return the states foretold at parameters, by the cell before or along the tangent."""
        if self.cells[sense]:
            return self.cells[sense][-1].at(s)
        if self.cells[-sense]:
            return self.cells[-sense][0].at(s)
        driven = list(self.loops.driven)
        ahead = np.zeros((self.loops.tree.count, len(s)))
        ahead[driven] = (self.drive(s) - self.drive(np.array([here]))) / self.loops.units[driven, None]
        start = Coordinates(np.repeat(self.start.values, len(s), 1), np.repeat(self.start.turns, len(s), -1))
        found = solver.linearise(start)
        opened = np.zeros_like(found.right)
        opened[:, : len(solver.rows)] = np.einsum("rkn,kn->nr", found.slope[solver.rows], ahead)
        return self.flat(self.loops.moved(start, ahead + solver.step(found.matrix, opened)))

    def parts(self, s: Array) -> Iterator[tuple[LoopSolver, NDArray[np.intp], Array]]:
        """Yield by what poses at parameters (n,) are solved: solver, which they are, and rough states.

        Raises:
            AssemblyError: at the parameter beyond which the loops cannot close in this assembly.
        """
        for end in (float(s.max()), float(s.min())):
            self.extend(end)
        cells = [*self.cells[-1][::-1], *self.cells[1]] or [self._dot()]
        ends = np.array([min(cell.nodes[0], cell.nodes[-1]) for cell in cells])
        of = np.clip(np.searchsorted(ends, s, side="right") - 1, 0, len(cells) - 1)
        rows = np.empty((len(s), cells[0].states.shape[1]))
        for i in np.unique(of):
            rows[of == i] = cells[i].at(s[of == i])
        known = {id(cell.solver): cell.solver for cell in cells}
        by = np.array([id(cell.solver) for cell in cells])[of]
        for key, solver in known.items():
            index = np.flatnonzero(by == key)
            if len(index):
                yield solver, index, rows[index]

    def blind(self, s: Array) -> NDArray[np.bool_]:
        """Return which parameters lie so near to a change point that the loops tell nothing, (n,)."""
        near = np.zeros(len(s), dtype=np.bool_)
        for meeting in self.meetings:
            near |= np.abs(s - meeting) < BLIND
        return near

    def rough(self, s: Array) -> Coordinates:
        """Return coordinates at parameters (n,) as the polynomials have them."""
        rows = np.empty((len(s), self.flat(self.start).shape[1]))
        for _, index, some in self.parts(s):
            rows[index] = some
        return self.unflat(rows, s)

    def derivatives(self, s: Array) -> tuple[Array, Array]:
        """Return first and second derivatives of flattened states by the parameter, off the polynomials."""
        cells = [*self.cells[-1], *self.cells[1]]
        first, second = (np.empty((len(s), cells[0].states.shape[1])) for _ in range(2))
        for i, at in enumerate(s):
            cell = next(cell for cell in cells if min(cell.nodes[[0, -1]]) <= at <= max(cell.nodes[[0, -1]]))
            once = cell.derivative()
            first[i], second[i] = once.at(s[i : i + 1])[0], once.derivative().at(s[i : i + 1])[0]
        return first, second

    def _dot(self) -> Cell:
        """Return the cell of a path that has not begun: its start alone."""
        return Cell(np.array([self.begin]), self.flat(self.start), np.ones(1), self._solver(self.begin, 1))
