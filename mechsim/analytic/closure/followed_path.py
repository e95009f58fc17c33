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

from mechsim.analytic.closure.loop_solver import FEW, TELLING, Linearised, LoopSolver, loop_solver
from mechsim.analytic.closure.meeting_cells import folded, meeting_between, through, touched
from mechsim.analytic.closure.path_cells import Cell, Drive, PathRows, nodes_between, roughness
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.errors import AssemblyError
from mechsim.maths.arrays import Array
from mechsim.model.motion import ChangePointPolicy
from mechsim.model.work_size import require_travel

# nodes of a cell, its first length and its longest, in radians of the drivers' motion, and how many times as
# long as the one before it may be at the most
NODES, FIRST, LONGEST, GROWTH = 9, 0.1, 1.2, 3.0
# a cell shorter than this ends at a singular pose
SHORTEST = 1e-13
# so much of a cell that its even nodes do not tell of the odd ones is not smooth
ROUGH = 1e-4
# roughness, and the way from what was foretold, at which the length of the next cell aims: they grow as the
# powers of the length that half the nodes stand for, and all of them
AIM, AIMED = 1e-5, 5e-3
# part of the cell about a change point within which poses are read off its polynomial, for there the loops
# tell nothing; and so near to one no path can begin
BLIND, CLEAR = 0.05, 1e-5
# a path that ends so near to its start may end because that is singular
AT_START = 1e-3
# what the poses of a cell may stand open by: a hundredth of what polynomials through them leave out; and so
# near to a singular pose that this would be taken for the path's bend
ENOUGH, BARELY = 1e-11, 1e-4
# what is taken for this where it is less
TINY = 1e-300
# two parameters nearer than this are one
NEAR = 1e-9
# a cell so short is foretold along the tangent: a polynomial through what rounding leaves of one tells less
STRAIGHT = 1e-5
# part of that cell's length beyond it for which it foretells the next: its many nodes foretell no farther
AFTER = 0.3
# to this a change point is known: rates where a path folds are those beyond it
JOINT = 1e-12
# at a start so far from a singular pose rounding leaves more of accelerations than a cell about a change
# point behind it would tell
WELL = 0.05
# how far beyond what was asked a path is followed: no round number, where change points like to lie
BEYOND = 0.2137


@dataclass(frozen=True, slots=True)
class Words:
    """What messages call a path: who moves, how far it is at a parameter, and when that is."""

    who: str
    place: Callable[[float], str]
    instant: Callable[[float], str]


CRANK = Words("the crank", lambda at: f"{at:.7g} rad", lambda at: f"crank angle {at:.7g} rad")


class FollowedPath(PathRows):
    """An assembly followed along a path of its drivers, as far as was asked.

    Attributes:
        first: what solves the loops about the start.
        start: where the path begins, one set of coordinates.
        begin: its parameter there.
        meetings: parameters at which assemblies meet, as they were passed.
        passing: how it goes on there.
        words: what moves, and what its parameter is called.
    """

    def __init__(
        self,
        first: LoopSolver,
        drive: Drive,
        at: float,
        passing: ChangePointPolicy = "smooth",
        words: Words = CRANK,
    ):
        super().__init__(first.loops, drive)
        self.first, self.start, self.begin = first, first.pinned, at
        self.passing: ChangePointPolicy = passing
        self.words = words
        self.cells: dict[int, list[Cell]] = {1: [], -1: []}
        self.meetings: list[float] = []
        self._blind: list[float] = []
        # of the singular poses that the last cell lies on; 0 where it is not known
        self.side = 0.0
        # the change point that comes next, once it is known, and the cell through it
        self._ahead: tuple[Cell, float] | None = None

    def extend(self, to: float) -> None:
        """Follow the assembly as far as a parameter, and a little beyond where it goes on.

        A change point is known for one only from beyond, and one behind the start blurs what is near it.

        Raises:
            AssemblyError: at the parameter beyond which the loops cannot close in this assembly.
        """
        if to == self.begin and abs(self.first.there.side[0]) > WELL:
            return
        sense = 1 if to > self.begin else -1
        with suppress(AssemblyError):
            self.reach(to + sense * BEYOND, sense)
            return
        self.reach(to, sense)

    def reach(self, to: float, sense: int) -> None:
        """Follow the assembly as far as a parameter and no farther.

        Raises:
            AssemblyError: at the parameter beyond which the loops cannot close in this assembly.
            InputError: for a path that is too long.
        """
        done, self.side, self._ahead = self.cells[sense], 0.0, None
        begin, words = self._end(sense), self.words
        who = f"{self._name}: {words.who}"
        require_travel(who, words.place(begin), words.place(to), abs(to - begin))
        length = AFTER * done[-1].length if done else FIRST
        if not done and self.cells[-sense]:
            length *= GROWTH  # no tangent foretells it
        while (left := sense * (to - self._end(sense))) > 0.0:
            here = self._end(sense)
            step = left if left <= length else min(length, 0.6 * left)
            cell, length = self.next_cell(here, sense, step)
            if cell is not None:
                done.append(cell)
            elif length < SHORTEST:
                raise AssemblyError(self._stuck(here))

    def _end(self, sense: int) -> float:
        """Return the parameter as far as which the path is followed in one sense."""
        return float(self.cells[sense][-1].nodes[-1]) if self.cells[sense] else self.begin

    def _stuck(self, here: float) -> str:
        """Return in one sentence why the path ends."""
        said = f"{self._name}: {self.words.who} cannot pass {self.words.place(here)} in this assembly"
        if abs(here - self.begin) < AT_START and self._singular_start():
            return (
                f"{said}, for at its start, {self.words.place(self.begin)}, it is at a dead centre or meets "
                "another that cannot be told from it; start elsewhere"
            )
        return f"{said}; stay on this side of the dead centre or change the dimensions"

    def _singular_start(self) -> bool:
        """Say whether the loops hold less at the start than beside it."""
        step = np.zeros((self.loops.tree.count, 1))
        step[self.loops.unknown, 0] = AT_START * self.first.gauge.sum(0)
        return loop_solver(self.loops, self.loops.moved(self.start, step)).open < self.first.open

    def next_cell(self, here: float, sense: int, step: float) -> tuple[Cell | None, float]:
        """Return the next cell, None where a shorter one must be tried, and the length to try next."""
        if self._ahead is not None:
            left = sense * (float(self._ahead[0].nodes[0]) - here)
            if left < NEAR:
                return self._passed(self._ahead, here, sense)
            step = min(step, left)
        solver = self._solver(here, sense)
        nodes, weights = nodes_between(here, here + sense * step, NODES)
        found = self.closed(solver, nodes, self.predicted(here, sense, solver, nodes), ENOUGH)
        if found is None:
            return None, 0.5 * step
        if (np.abs(found[1].side) < BARELY).any():
            found = self.closed(solver, nodes, found[0]) or found
        states, loops, moved = found
        rough = float(roughness(states).max())
        if rough > ROUGH:
            return None, 0.5 * step
        serves, whole = solver.telling(loops)
        cell = Cell(nodes, states, weights, solver, serves)
        if not whole.all():
            cell, loops = self._told(cell, loops, whole)
        share, signs = cell.solver.share(loops), np.sign(loops.side)
        if share.min() < FEW * share.max():
            return None, 0.5 * step
        flips = np.flatnonzero(signs[1:] != signs[:-1])
        if len(flips):
            return None, step if self._met(cell, int(flips[0]), sense) else 0.5 * step
        if (behind := touched(loops.size)) is not None and self._met(cell, behind, sense):
            return None, step
        middle, done = float(signs[NODES // 2]), self.cells[sense]
        if self.side * middle < 0.0 and cell.solver is done[-1].solver:
            # the change point lies where the last cell ends
            length = done[-1].length
            return None, 0.6 * length if self.take_back(sense) else 0.5 * step
        self.side = middle
        return cell, min(LONGEST, step * self.growth(step, sense, rough, moved))

    def growth(self, step: float, sense: int, rough: float, moved: float) -> float:
        """Return how many times as long as a cell the next may be."""
        growth = min(GROWTH, (AIM / max(rough, TINY)) ** (2.0 / (NODES + 1)))
        if not self.cells[sense]:
            return growth  # a tangent foretold it
        # a polynomial errs by the product of the distances to its nodes
        before = self.cells[sense][-1].length
        return min(growth, (1.0 + 0.5 * before / step) * (AIMED / max(moved, TINY)) ** (1.0 / NODES) - 0.5)

    def _told(self, cell: Cell, closed: Linearised, whole: NDArray[np.bool_]) -> tuple[Cell, Linearised]:
        """Return a cell solved by rows that tell enough where it is near a singular pose, and its loops.

        Rows that repeat others elsewhere may be the ones that count there.

        Args:
            cell: solved by rows that do not tell the whole everywhere.
            closed: its loops.
            whole: at which nodes they do.
        """
        old = cell.solver
        # the nearest node may be the singular pose itself
        beside = np.argsort(np.abs(closed.side))[1:2]
        if whole[beside[0]]:
            return cell, closed
        nearest = self.unflat(cell.states[beside], cell.nodes[beside])
        solver = loop_solver(self.loops, nearest, old.gauge, closed.slope[..., beside])
        if np.array_equal(solver.rows, old.rows):
            return cell, closed
        own = abs(np.linalg.det(closed.matrix[beside[0]]))
        best = abs(np.linalg.det(solver.linearise(nearest).matrix[0]))
        if solver.open != old.open or own > TELLING * best:
            return cell, closed
        found = self.closed(solver, cell.nodes, cell.states)
        if found is None:
            return cell, closed
        told = replace(cell, states=found[0], solver=solver, serves=solver.telling(found[1])[0])
        return told, found[1]

    def _met(self, cell: Cell, flip: int, sense: int) -> bool:
        """Say whether a change point lies behind a node of a cell; the path then stops where its cell begins.

        Where it is none, but a sharp bend of the path or its end, shorter cells will show.
        """
        a, b = cell.nodes[flip : flip + 2]
        meeting = meeting_between(self, cell, float(a), float(b))
        if meeting is not None:
            self._ahead = through(self, cell, meeting, sense)
        if meeting is None or self._ahead is None:
            return False
        first = float(self._ahead[0].nodes[0])
        while sense * (first - self._end(sense)) < -NEAR and self.take_back(sense):
            pass
        return True

    def _passed(self, ahead: tuple[Cell, float], here: float, sense: int) -> tuple[Cell, float]:
        """Return the cell that leads on from a change point, and the length to try next.

        Raises:
            AssemblyError: where the path begins at the change point, or cannot fold there.
        """
        self._ahead, self.side = None, 0.0
        whole, meeting = ahead
        away, beyond = sense * (meeting - here), sense * (float(whole.nodes[-1]) - meeting)
        if away < CLEAR:
            raise AssemblyError(
                f"{self._name}: assemblies meet at {self.words.instant(meeting)}, {abs(away):.3g} rad from "
                "the start or from where others meet, and cannot be told from each other; start elsewhere or "
                "change the dimensions"
            )
        after = (
            folded(self, whole, meeting)
            if self.passing == "branch"
            else whole.part(here, meeting + sense * beyond)
        )
        if after is None:
            raise AssemblyError(
                f"{self._name}: {self.words.who} cannot pass {self.words.place(meeting)} by folding, "
                "for it does not turn in the assembly that is met there; go on smoothly"
            )
        if self.passing == "branch":
            self.cells[sense].append(whole.part(here, meeting))
        beyond = sense * (float(after.nodes[-1]) - meeting)
        self.meetings.append(meeting)
        self._blind.append(BLIND * beyond)
        return after, AFTER * beyond

    def take_back(self, sense: int) -> bool:
        """Take back the last cell; False where there is none, or it leads through a change point."""
        if not self.cells[sense]:
            return False
        first, last = self.cells[sense][-1].nodes[[0, -1]]
        if any(sense * (at - first) >= 0.0 and sense * (last - at) >= 0.0 for at in self.meetings):
            return False
        self.cells[sense].pop()
        self.side = 0.0
        return True

    def _solver(self, here: float, sense: int) -> LoopSolver:
        if not self.cells[sense]:
            return self.first
        cell = self.cells[sense][-1]
        if cell.serves is not None and cell.serves[-1]:
            return cell.solver
        at = self.unflat(cell.states[[-1]], np.array([here]))
        if cell.serves is None and cell.solver.telling(cell.solver.linearise(at))[0][0]:
            return cell.solver
        return loop_solver(self.loops, at, cell.solver.gauge)

    def predicted(self, here: float, sense: int, solver: LoopSolver, s: Array) -> Array:
        """Return the states foretold at parameters, by the cell before or along the tangent."""
        done = self.cells[sense]
        if done and abs(float(s[-1]) - here) > STRAIGHT:
            return done[-1].at(s)
        if not done and self.cells[-sense]:
            return self.cells[-sense][0].at(s)
        driven = list(self.loops.driven)
        ahead = np.zeros((self.loops.tree.count, len(s)))
        ahead[driven] = (self.drive(s) - self.drive(np.array([here]))) / self.loops.units[driven, None]
        last = self.unflat(done[-1].states[[-1]], np.array([here])) if done else self.start
        found = solver.linearise(last) if done else solver.there
        opened = np.zeros((len(s), len(solver.loops.unknown)))
        opened[:, : len(solver.rows)] = (found.slope[solver.rows, :, 0] @ ahead).T
        start = Coordinates(np.repeat(last.values, len(s), 1), np.repeat(last.turns, len(s), -1))
        return self.flat(self.loops.moved(start, ahead + solver.step(found.matrix, opened)))

    def parts(self, s: Array) -> Iterator[tuple[LoopSolver, NDArray[np.intp], Array]]:
        """Yield by what poses at parameters (n,) are solved: solver, which they are, and rough states.

        Raises:
            AssemblyError: at the parameter beyond which the loops cannot close in this assembly.
        """
        for end in (float(s.max()), float(s.min())):
            self.extend(end)
        cells = [*self.cells[-1][::-1], *self.cells[1]] or [self._dot()]
        of = _places(cells, s)
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
        for meeting, blind in zip(self.meetings, self._blind, strict=True):
            near |= np.abs(s - meeting) < blind
        return near

    def rough(self, s: Array) -> Coordinates:
        """Return coordinates at parameters (n,) as the polynomials have them."""
        rows = np.empty((len(s), self.flat(self.start).shape[1]))
        for _, index, some in self.parts(s):
            rows[index] = some
        return self.unflat(rows, s)

    def derivatives(self, s: Array) -> tuple[Array, Array]:
        """Return first and second derivatives of flattened states by the parameter, off the polynomials."""
        cells = [*self.cells[-1][::-1], *self.cells[1]]
        first, second = np.empty((2, len(s), cells[0].states.shape[1]))
        of = _places(cells, s)
        for i in np.unique(of):
            once, here = cells[i].derivative(), of == i
            first[here], second[here] = once.at(s[here]), once.derivative().at(s[here])
        return first, second

    @property
    def _name(self) -> str:
        return self.loops.tree.mechanism.name

    def _dot(self) -> Cell:
        """Return the cell of a path that has not begun: its start alone."""
        return Cell(np.array([self.begin]), self.flat(self.start), np.ones(1), self._solver(self.begin, 1))


def _places(cells: list[Cell], s: Array) -> NDArray[np.intp]:
    """Return in which of some cells in a row parameters lie, (n,); where two join, in the later one."""
    lows = np.array([cell.low for cell in cells])
    return np.clip(np.searchsorted(lows, s + JOINT, side="right") - 1, 0, len(cells) - 1)
