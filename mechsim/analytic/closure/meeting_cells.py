"""Change points of a path: where two assemblies meet, and the cell that goes through, or on in the other."""

from dataclasses import replace

import numpy as np

from mechsim.analytic.closure.loop_solver import FEW, Linearised
from mechsim.analytic.closure.path_cells import Cell, PathRows, nodes_between, roughness
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.maths.arrays import Array

# half the length of a cell about a change point, and the shortest, where the path bends sharply
ABOUT, SHARPEST = 0.1, 5e-4
# pairs of assemblies that may meet at once without a change of side; and part of its roughness as it stands
# that a curve may keep where its sign is to change
PAIRS, KINKED = (2, 4), 0.3
# nodes of such a cell: an even number, so that none lies at it, where the loops hold nothing
MANY = 24
# what the last terms of its polynomial may be, in radians or parts of the size: rounding, where
# the loops hardly hold the nearest nodes
SMOOTH = 1e-11
# distances from a change point at which its side is measured: far, and nearest
FAR, NEAR = 1e-3, 3e-7
# turn along the direction that the loops leave free there, by which it is seen how they bend; what of
# that must be left if the other assembly is to be left by turning the crank; how far from where it is
# foretold it may be found, as a part of its distance; and how often the stretch is halved for that
APART, BENT, BESIDE, HALVINGS = 1e-4, 1e-6, 0.3, 6


def touched(size: Array) -> int | None:
    """Return behind which node of a cell pairs of assemblies may meet at once, an even number of them.

    No side changes there. The determinant touches nought, and its root of that number is only smooth if
    its sign changes. None where it is smooth as it stands.

    Args:
        size: logarithm of the determinant's size at the nodes, (k,).
    """
    signs = np.where(np.arange(len(size)) > np.arange(len(size) - 1)[:, None], -1.0, 1.0)
    for pairs in PAIRS:
        root = np.exp((size - size.max()) / pairs)
        rough = roughness((signs * root).T)
        behind = int(np.argmin(rough))
        if rough[behind] < KINKED * roughness(root[:, None])[0]:
            return behind
    return None


def meeting_between(path: PathRows, cell: Cell, a: float, b: float) -> float | None:
    """Return where two assemblies meet between two nodes; None where they only come near each other.

    Or where no more than the rows that are solved repeat each other. Where the side is the same at both
    nodes it is where it touches nought, as two pairs of assemblies meet at once.
    """

    def looked(s: Array) -> Linearised | None:
        found = path.closed(cell.solver, s, cell.at(s))
        return None if found is None else found[1]

    beside = looked(np.array([a, b])) if abs(b - a) > NEAR else None
    if beside is None:
        return None
    ends = beside.side
    kept = bool(ends[0] * ends[1] > 0.0)

    def across(found: Linearised, s: Array) -> Array:
        return np.where(kept & ((s - at) * (b - a) > 0.0), -found.side, found.side)

    ends = ends * np.array([1.0, -1.0 if kept else 1.0])
    at, rate = a - ends[0] * (b - a) / (ends[1] - ends[0]), 0.0
    for apart in (min(0.1 * abs(b - a), FAR), 0.03 * FAR):
        # a parabola through three points on either side of where the root is thought to be
        around = at + apart * np.array([-2.0, -1.0, 1.0, 2.0])
        found = looked(around)
        if found is None:
            return None
        side = across(found, around)
        if not np.all(np.sign(side[[0, 1]]) == -np.sign(side[[2, 3]])):
            return None
        parabola = np.polynomial.Polynomial.fit((around - at) / apart, side, 2)
        roots = parabola.roots()
        real = roots[np.abs(roots.imag) < 1e-12].real
        if not len(real):
            return None
        rate = float(parabola.deriv()(0.0)) / apart
        at += apart * float(real[np.argmin(np.abs(real))])
    near = at + NEAR * np.array([-2.0, -1.0, 1.0, 2.0])
    there = looked(near)
    if there is None or cell.solver.share(there).min() < FEW * cell.solver.share(beside).max():
        return None
    meant = rate * (near - at)
    return at if np.abs(across(there, near) - meant).max() < 0.2 * abs(rate) * NEAR else None


def through(path: PathRows, cell: Cell, meeting: float, sense: int) -> tuple[Cell, float] | None:
    """Return the longest cell that goes through a meeting, as far before as beyond, and where that is.

    None where none is sure.

    Args:
        path: whose poses they are.
        cell: that leads up to the meeting and beyond.
        meeting: parameter.
        sense: in which the path is followed, +1 or -1.
    """
    longest, away = abs(float(cell.nodes[-1] - cell.nodes[0])), ABOUT
    while away > SHARPEST:
        if away <= longest:
            nodes, weights = nodes_between(meeting - sense * away, meeting + sense * away, MANY)
            found = path.closed(cell.solver, nodes, cell.at(nodes))
            if found is not None:
                side = np.sign(found[1].side)
                kept = abs(side.sum()) == MANY
                crossed = abs((side * np.sign(nodes - meeting)).sum()) == MANY
                longer = Cell(nodes, found[0], weights, cell.solver)
                if (kept or crossed) and longer.left_out() < SMOOTH:
                    heights = replace(longer, states=np.linalg.det(found[1].matrix)[:, None])
                    return longer, _zero(heights.derivative() if kept else heights, meeting)
        away *= 0.5
    return None


def _zero(heights: Cell, near: float) -> float:
    """Return where a polynomial (k, 1) is nought, by Newton's method; as it was where that leads astray."""
    at, slope = np.array([near]), heights.derivative()
    for _ in range(3):
        at = at - heights.at(at)[0] / slope.at(at)[0]
    # where more than one direction is left free, the determinant has no slope
    return float(at[0]) if abs(at[0] - near) < NEAR else near


def folded(path: PathRows, smooth: Cell, meeting: float) -> Cell | None:
    """Return the cell that goes on from a meeting in the other assembly, on the same side of it.

    None where the crank does not turn in the other one.

    Args:
        path: whose poses they are.
        smooth: the cell that goes through.
        meeting: parameter.
    """
    slope = _aside(path, smooth, meeting)
    if slope is None:
        return None
    away = float(smooth.nodes[-1]) - meeting
    for _ in range(HALVINGS):
        nodes, weights = nodes_between(meeting - away, meeting + away, MANY)
        aside = (nodes - meeting)[:, None] * slope
        here = path.closed(smooth.solver, nodes, smooth.at(nodes))
        there = path.closed(smooth.solver, nodes, smooth.at(nodes) + aside)
        if here is not None and there is not None:
            other = Cell(nodes, there[0], weights, smooth.solver)
            gone = np.abs(there[0] - smooth.at(nodes) - aside).max(1)
            found = (gone < BESIDE * np.abs(aside).max(1)).all()
            if found and (here[1].side * there[1].side < 0.0).all() and other.left_out() < SMOOTH:
                return other.part(meeting, meeting + away)
        away *= 0.5
    return None


def _aside(path: PathRows, smooth: Cell, meeting: float) -> Array | None:
    """Return by how much the other assembly's path is steeper at a meeting, (w,); None where it is upright.

    What the loops say, looked at along the direction that they leave free, is z (a x + b z) at x beyond the
    meeting and z aside: nought at z = 0, this assembly, and at z = -a x / b, the other.
    """
    at = np.array([meeting])
    here = path.unflat(smooth.at(at), at)
    loops, solver = path.loops, smooth.solver
    left, _, right = np.linalg.svd(solver.linearise(here).matrix[0])
    tells, free = left[:, -1], np.zeros((loops.tree.count, 1))
    free[loops.unknown, 0] = right[-1]

    def told(rows: Coordinates) -> Array:
        return solver.linearise(rows).matrix @ right[-1] @ tells

    aside = [loops.moved(here, sign * APART * free) for sign in (1.0, -1.0)]
    beyond = at + APART * np.array([1.0, -1.0])
    a = float(np.diff(told(path.unflat(smooth.at(beyond), beyond))[::-1])[0])
    b = 0.5 * float(told(aside[0])[0] - told(aside[1])[0])
    if not abs(b) > BENT * abs(a):
        return None
    return -a / b * (path.flat(aside[0]) - path.flat(aside[1]))[0] / (2.0 * APART)
