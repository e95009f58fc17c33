"""A curve of assemblies cell by cell: closed coordinates at nodes, and polynomials through them by the arc.

The way on is foretold by the polynomials of the cell before, closed at all nodes together across the
curve, and taken only where it lies close to what was foretold and is smooth. So a turning point of any
coordinate is nothing special, and a place where assemblies meet is passed on the branch that goes
straight on; it is measured, and no node lies near it, for there the loops tell little.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from mechsim.analytic.closure.loop_solver import LoopSolver
from mechsim.analytic.closure.tree_motion import Coordinates, link_poses
from mechsim.errors import AssemblyError
from mechsim.maths import polynomials
from mechsim.maths.arrays import Array
from mechsim.maths.roots import root
from mechsim.theory.continuation.endless import require_return
from mechsim.theory.continuation.free_loops import Closed, FreeLoops

# nodes of a cell; every second of them foretell the next
NODES = 17
# first length of a cell, the longest and the shortest, as arc
FIRST, LONGEST, SHORTEST = 0.05, 3.0, 1e-9
# cells shorter than this foretell the next by polynomials of a low degree
SHORT, LOW = 1e-3, 3
# what every second node may not tell of the others, and how far marks may lie from what was foretold, as
# parts of the length of the cell
ROUGH, ASTRAY = 3e-9, 2e-2
# least cosine between the direction of a cell's start and any of its nodes
AHEAD = 0.5
# how far nodes keep from where assemblies meet, as arc; they meet where the singular value is smaller than
# MEET parts of the largest and the loops stand open by no more than ROUNDED; below NEAR it is looked for
CLEAR, MEET, ROUNDED, NEAR = 2e-3, 1e-7, 2e-13, 0.3
# distance of marks at which a place is the same
SAME = 1e-9
# cells of a curve at the most
MOST = 3000


@dataclass(frozen=True)
class Stretch:
    """A stretch of a curve.

    Attributes:
        low: arc at its start.
        high: arc at its end.
        nodes: arcs at which its coordinates are closed, (k,).
        closed: coordinates there.
        rows: coefficients of the flattened coordinates over the arc, (k, w).
        marks: of the marks, (k, m).
        ahead: rates of the unknown coordinates at its end, in their units, (unknowns,).
        solver: by which its poses are solved.
        largest: singular value that vanishes where assemblies meet, at its largest so far.
    """

    low: float
    high: float
    nodes: Array
    closed: Coordinates
    rows: Array
    marks: Array
    ahead: Array
    solver: LoopSolver
    largest: float

    def at(self, coefficients: Array, arc: Array) -> Array:
        """Return polynomials at arcs (n,), (n, w)."""
        return polynomials.value(coefficients, self.scaled(arc))

    def fitted(self, values: Array) -> Array:
        """Return the coefficients of the polynomials through values at the nodes, (k, w)."""
        return polynomials.fitted(self.scaled(self.nodes), values)

    @cached_property
    def slopes(self) -> Array:
        """Coefficients of the rates of the marks by the arc, (k - 1, m)."""
        return polynomials.derivative(self.marks) * 2.0 / (self.high - self.low)

    def foretold(self, loops: FreeLoops, arc: Array) -> Array:
        """Return flattened coordinates beyond its end, by a polynomial of lower degree.

        The higher, the more it magnifies the rounding of the nodes, which short cells feel.
        """
        degree = NODES // 2 if self.high - self.low > SHORT else LOW
        fit = polynomials.smoothed(self.scaled(self.nodes), loops.flat(self.closed), degree)
        return polynomials.value(fit, self.scaled(arc))

    def scaled(self, arc: Array) -> Array:
        """Return arcs as parts of the cell, -1 at its start and 1 at its end."""
        return (2.0 * arc - self.low - self.high) / (self.high - self.low)


@dataclass(frozen=True, slots=True)
class Walked:
    """A closed curve.

    Attributes:
        cells: one after the other.
        length: arc at which it has come back to its start.
        meetings: arcs at which assemblies meet.
    """

    cells: tuple[Stretch, ...]
    length: float
    meetings: tuple[float, ...]

    def place(self, arc: float) -> int:
        """Return the index of the cell in which an arc lies."""
        highs = [cell.high for cell in self.cells]
        return min(int(np.searchsorted(highs, arc)), len(highs) - 1)


def walk_round(
    loops: FreeLoops,
    start: Coordinates,
    along: Array | None = None,
    tick: Callable[[int, int], None] | None = None,
) -> Walked:
    """Walk along a curve of assemblies until it has come back to its start.

    Args:
        loops: of the mechanism.
        start: one set of closed coordinates, away from where assemblies meet.
        along: in which of the two directions, as rates of the unknowns; None lets the driver rise.
        tick: is told after each cell how many there are, and how many there may be.

    Raises:
        AssemblyError: where the curve has no smooth way on, or does not close.
        MobilityError: where more than one freedom is open.
    """
    solver, begin = loops.solver(start, _crank(loops) if along is None else along), start
    cells: list[Stretch] = []
    meetings: list[float] = []
    length, largest = FIRST, 0.0
    first = loops.close(solver, start)
    assert first is not None
    plane = first.rates[0] / np.linalg.norm(first.rates[0])
    while len(cells) < MOST:
        cell, met, length = _next(loops, cells, solver, start, length, largest)
        if cell is None:
            if length < SHORTEST:
                raise AssemblyError(_stuck(loops, start))
            continue
        meetings += met
        home = _homecoming(cell, first.marks[0], plane, not cells)
        if home is not None and not _counted_alike(loops, cell, home, begin):
            home = None
        cells.append(cell)
        if home is not None:
            return Walked(tuple(cells), home, tuple(at for at in meetings if at < home))
        if tick is not None:
            tick(len(cells), MOST)
        largest = max(largest, cell.largest)
        start = loops.unflat(cell.at(cell.rows, np.array([cell.high])))
        require_return(loops.loops, begin, start)
        solver = loops.solver(start, cell.ahead)
    raise AssemblyError(
        f"{loops.loops.tree.mechanism.name}: the curve has not come back to its start after a length of "
        f"{cells[-1].high:.4g}, in {MOST:,} cells, the most that are walked; gears come round after as many "
        "turns as their ratio asks, and never where it is none of whole numbers: change it, or solve the "
        "mechanism over the turns that are wanted"
    )


def _next(
    loops: FreeLoops,
    done: list[Stretch],
    solver: LoopSolver,
    start: Coordinates,
    length: float,
    largest: float,
) -> tuple[Stretch | None, list[float], float]:
    """Return the next cell, None where another length must be tried; its meetings; and the length to try."""
    low = done[-1].high if done else 0.0
    places = 0.5 * length * (1.0 - np.cos(np.pi * np.arange(NODES) / (NODES - 1)))
    straight = np.zeros((loops.loops.tree.count, NODES))
    straight[loops.loops.unknown] = np.outer(solver.null_space[0], places)
    guesses = [loops.unflat(done[-1].foretold(loops, low + places))] if done else []
    if length < SHORT or not done:
        # about a sharp bend rounding tells more of the direction than of what is foretold
        guesses.append(loops.loops.displaced(_repeated(start), straight))
    cell = found = None
    for guess in guesses:
        found = loops.close(solver, guess)
        cell = None if found is None else _cell(loops, found, guess, solver, low, largest)
        if cell is not None:
            break
    if cell is None or found is None:
        return None, [], 0.5 * length
    rough = _roughness(loops, cell)
    if rough > ROUGH:
        return None, [], min(0.5, 0.9 * (ROUGH / rough) ** (2.0 / NODES)) * length
    met = _meetings(loops, cell, found)
    flips = int((found.side[1:] != found.side[:-1]).sum())
    if flips > len(met):
        # it is no meeting, but a sharp bend that a shorter cell will show
        return None, [], 0.5 * length
    if any(np.abs(cell.nodes - at).min() < CLEAR for at in met):
        return None, [], 0.87 * length
    growth = 0.8 * (ROUGH / max(rough, 1e-16)) ** (2.0 / NODES)
    return cell, met, min(LONGEST, max(0.5, min(growth, 2.0)) * (cell.high - cell.low))


def _cell(
    loops: FreeLoops, found: Closed, guess: Coordinates, solver: LoopSolver, low: float, largest: float
) -> Stretch | None:
    """Return the cell through closed coordinates; None where they lie far from the guess or not in a row."""
    speed = np.sqrt((found.rates**2).sum(1))
    cosines = (found.rates @ found.rates[0]) / (speed * speed[0])
    # nodes that rounding leaves in one place carry no polynomial
    apart = np.diff(found.length) > 1e-14 * max(1.0, low)
    if not (cosines.min() > AHEAD and apart.all()):
        return None
    nodes = low + polynomials.integral(found.length, speed)
    high, nothing = float(nodes[-1]), np.empty(0)
    largest = max(largest, float(found.least.max()))
    cell = Stretch(low, high, nodes, found.at, nothing, nothing, found.along[-1], solver, largest)
    foretold = loops.marks.at(link_poses(loops.loops.tree, guess))
    if not np.abs(foretold - found.marks).max() < ASTRAY * (high - low):
        return None
    fits = {"rows": cell.fitted(loops.flat(found.at)), "marks": cell.fitted(found.marks)}
    return replace(cell, **fits)


def _roughness(loops: FreeLoops, cell: Stretch) -> float:
    """Return what every second node does not tell of the others."""
    states = loops.flat(cell.closed)
    fit = polynomials.fitted(cell.scaled(cell.nodes[::2]), states[::2])
    return float(np.abs(polynomials.value(fit, cell.scaled(cell.nodes[1::2])) - states[1::2]).max())


def _meetings(loops: FreeLoops, cell: Stretch, found: Closed) -> list[float]:
    """Return the arcs in a cell at which assemblies meet."""
    met: list[float] = []
    least = found.least
    for i in range(NODES):
        left, right = max(i - 1, 0), min(i + 1, NODES - 1)
        if not (least[i] <= min(least[left], least[right]) and least[i] < NEAR * cell.largest):
            continue
        at, value, gap = loops.meeting(
            lambda arc: cell.at(cell.rows, arc), float(cell.nodes[left]), float(cell.nodes[right])
        )
        if value < MEET * cell.largest and gap < ROUNDED and not any(abs(at - one) < CLEAR for one in met):
            met.append(at)
    return met


def _homecoming(cell: Stretch, home: Array, plane: Array, first: bool) -> float | None:
    """Return the arc at which a cell passes the start of the curve."""
    ahead = (cell.at(cell.marks, cell.nodes) - home) @ plane
    for i in np.flatnonzero((ahead[:-1] < 0.0) & (ahead[1:] >= 0.0)):
        if first and i == 0:
            continue

        def past(arc: float) -> float:
            return float((cell.at(cell.marks, np.array([arc]))[0] - home) @ plane)

        low, high = float(cell.nodes[i]), float(cell.nodes[i + 1])
        at = root(past, low, high) if past(low) < 0.0 < past(high) else high
        if np.abs(cell.at(cell.marks, np.array([at]))[0] - home).max() < SAME:
            return at
    return None


def _counted_alike(loops: FreeLoops, cell: Stretch, arc: float, begin: Coordinates) -> bool:
    """Whether coordinates whose turns a coupling counts, as that of a screw, are back where they began."""
    tree = loops.loops.tree
    weights = [np.abs(row.left) + np.abs(row.right) for row in loops.loops.couplings if not row.turns]
    counted = np.flatnonzero(np.sum(weights, 0)) if weights else []
    gone = cell.at(cell.rows, np.array([arc]))[0, : tree.count] - begin.values[:, 0] / loops.loops.units
    return bool((np.abs(gone[counted]) < 1e-6).all())


def _crank(loops: FreeLoops) -> Array:
    tree = loops.loops.tree
    along = np.zeros(tree.count)
    along[tree.index_of[tree.mechanism.drivers[0]]] = 1.0
    return along[loops.loops.unknown]


def _repeated(at: Coordinates) -> Coordinates:
    return Coordinates(np.repeat(at.values, NODES, 1), np.repeat(at.turns, NODES, -1))


def _stuck(loops: FreeLoops, at: Coordinates) -> str:
    tree = loops.loops.tree
    driver = tree.mechanism.drivers[0]
    return (
        f"{tree.mechanism.name}: the curve of assemblies has no smooth way on at {driver} = "
        f"{at.values[tree.index_of[driver], 0]:.7g}; change the dimensions a little"
    )
