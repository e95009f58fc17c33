"""The search for all curves of assemblies: poses that were found, and the curves on which they lie."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure.numerical_rank import significant
from mechsim.analytic.closure.random_starts import poses_around_branch_point, select
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.errors import AssemblyError, MobilityError
from mechsim.maths.arrays import Array
from mechsim.theory.continuation.assembly_curve import AssemblyCurve
from mechsim.theory.continuation.cells import walk_round
from mechsim.theory.continuation.free_loops import FreeLoops

# distance of marks below which a pose lies on a curve
ON_CURVE = 1e-7
# singular values below this part of the largest are nought at a pose from a random start
NOUGHT = 1e-5
# curves that may fail before the rest is left
MOST_FAILED = 3


class CurveSearch:
    """Poses that were found, and the curves on which they lie.

    Attributes:
        loops: of the mechanism.
        tick: is told what is done, and which part of it at the least.
    """

    def __init__(self, loops: FreeLoops, tick: Callable[[str, float], None]):
        self.loops, self.tick = loops, tick
        self.curves: list[AssemblyCurve] = []
        self.at: list[Coordinates] = []
        self.of = np.empty(0, dtype=np.intp)
        self.counted = np.empty(0, dtype=np.bool_)
        self.marks: Array = np.empty((0, 3 * len(loops.marks.links)))
        self.least = np.empty(0)
        self.freedoms = np.empty(0, dtype=np.intp)
        self.failed: list[str] = []

    def take(self, poses: Coordinates, *, counted: bool) -> None:
        """Take poses into the search."""
        if not len(poses):
            return
        _, slope, here = self.loops.loops.linearise(poses)
        by_unknowns = slope[:, self.loops.loops.unknown].transpose(2, 0, 1)
        values = np.linalg.svd(by_unknowns, compute_uv=False)
        rank = significant(values, NOUGHT).sum(1)
        self.at += [select(poses, np.array([i])) for i in range(len(poses))]
        self.marks = np.concatenate([self.marks, self.loops.marks.at(here)])
        self.least = np.concatenate([self.least, self.loops.least(slope)])
        self.freedoms = np.concatenate([self.freedoms, 1 + self.loops.rank - rank])
        self.counted = np.concatenate([self.counted, np.full(len(poses), counted)])
        self.of = np.concatenate([self.of, np.full(len(poses), -1)])
        for i, curve in enumerate(self.curves):
            self._assign(i, curve)

    def walk(self, start: int) -> None:
        """Walk the curve through a pose."""
        which = len(self.curves) + 1

        def walked(cells: int, most: int) -> None:
            self.tick(f"component {which}, cell {cells} of {most:,} at the most", cells / most)

        curve = AssemblyCurve(self.loops, walk_round(self.loops, self.at[start], tick=walked))
        self.curves.append(curve)
        self.of[start] = len(self.curves) - 1
        self._assign(len(self.curves) - 1, curve)

    def beside(self, index: int) -> None:
        """Take poses on the branches that leave the meetings of a curve."""
        curve = self.curves[index]
        for arc in curve.meetings:
            cell = curve.walked.cells[curve.walked.place(arc)]
            there = self.loops.unflat(cell.at(cell.rows, np.array([arc])))
            self.take(poses_around_branch_point(self.loops.loops, there), counted=False)

    def walk_all(self) -> None:
        """Walk curves until every pose that can move lies on one."""
        while len(self.failed) < MOST_FAILED:
            waiting = np.flatnonzero((self.of == -1) & (self.freedoms == 1))
            if not len(waiting):
                return
            best = int(waiting[np.argmax(self.least[waiting])])
            try:
                self.walk(best)
            except (AssemblyError, MobilityError) as error:
                self.of[best] = -2
                self.failed.append(str(error))
                continue
            self.beside(len(self.curves) - 1)

    def counts(self) -> list[int]:
        """Return how many counted poses lie on each curve."""
        return [int((self.counted & (self.of == i)).sum()) for i in range(len(self.curves))]

    def left_out(self) -> list[str]:
        """Return what was found and not traced, a sentence each."""
        said = [f"not traced: {reason}" for reason in self.failed]
        lost = self.counted & (self.of < 0)
        for what, which in (
            ("in poses that cannot move", self.freedoms < 1),
            ("where more than one freedom is open", self.freedoms > 1),
            ("on curves that were not traced", self.freedoms == 1),
        ):
            if count := int((lost & which).sum()):
                said.append(f"{count} of {int(self.counted.sum())} assemblies found were {what}")
        return said

    def _assign(self, index: int, curve: AssemblyCurve) -> None:
        waiting = np.flatnonzero(self.of == -1)
        if len(waiting):
            self.of[waiting[lie_on(curve, self.marks[waiting])]] = index


def lie_on(curve: AssemblyCurve, marks: Array) -> NDArray[np.bool_]:
    """Return which of many sets of marks lie on a curve, (n,)."""
    arcs = np.concatenate([cell.nodes for cell in curve.walked.cells])
    known = np.concatenate([cell.at(cell.marks, cell.nodes) for cell in curve.walked.cells])
    on, apart = np.zeros(len(marks), dtype=np.bool_), (np.diff(arcs, append=curve.length) ** 2).max()
    for i, one in enumerate(marks):
        gaps = ((known - one) ** 2).sum(1)
        # a curve that comes near itself has more than one place that may be it
        for k in np.flatnonzero((gaps <= np.roll(gaps, 1)) & (gaps <= np.roll(gaps, -1))):
            if gaps[k] < apart and _distance(curve, float(arcs[k]), one) < ON_CURVE:
                on[i] = True
                break
    return on


def _distance(curve: AssemblyCurve, arc: float, marks: Array) -> float:
    """Return the distance of marks from a curve near an arc."""
    distance = np.inf
    for _ in range(6):
        arc %= curve.length
        cell = curve.walked.cells[curve.walked.place(arc)]
        at = np.array([arc])
        gap = marks - cell.at(cell.marks, at)[0]
        distance = float(np.abs(gap).max())
        ahead = cell.at(cell.slopes, at)[0]
        step = float(gap @ ahead) / float(ahead @ ahead)
        # it stays where it is: nearer than this the curve does not come
        if abs(step) < 0.1 * ON_CURVE:
            break
        arc += step
    return distance
