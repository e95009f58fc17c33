"""Many designs of one mechanism followed together along one path of their drivers, each in its own assembly.

All nodes of a segment are corrected together for all designs, as for one mechanism (`path`). Designs whose
segment is rejected are divided from the others and go on with shorter ones; those that need very short ones,
and those whose assemblies meet others, are left to be followed by themselves.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.assembly_errors import ASSEMBLY, CLOSED
from mechsim.analytic.loops.constraints import Cut, LoopSystem, TreeLoops, axes_aligned
from mechsim.analytic.loops.kinematics import Coordinates, LinkPoses
from mechsim.analytic.loops.path import ContinuationPath
from mechsim.analytic.loops.path_segments import ClosedNodes, Segment
from mechsim.analytic.loops.solver import LoopSolver
from mechsim.analytic.loops.tree import JointSides
from mechsim.errors import AssemblyError
from mechsim.model.design_arrays import DesignArrays, StartedDesigns
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import newton
from mechsim.numerics.rank import least_norm, significant
from mechsim.numerics.step_control import StepControl

Rows = NDArray[np.intp]
Bools = NDArray[np.bool_]
# numbers of instants for which equations are kept
MAX_KEPT = 4


@dataclass(frozen=True)
class DesignLoops(TreeLoops):
    """Loop equations of d designs that differ only in where their joints and points are.

    Lengths of all are counted in the size of the mechanism of the tree. Of n instants each d in a row are
    those of the designs.

    Attributes:
        arrays: numbers of the designs.
        which: of all designs they are, (d,).
    """

    arrays: DesignArrays
    which: Rows

    def select(self, which: Rows) -> "DesignLoops":
        """Return the loops of some of the designs."""
        return replace(self, arrays=self.arrays.subset(which), which=self.which[which])

    def linearise(self, q: Coordinates) -> tuple[Array, Array, LinkPoses]:
        """Return residuals, Jacobians and links about n sets of coordinates, as `TreeLoops` does."""
        return self.at_instants(len(q)).linearise(q)

    def at_instants(self, count: int) -> TreeLoops:
        """Return the equations with the numbers of each of so many instants."""
        if count not in self._kept:
            if len(self._kept) == MAX_KEPT:
                self._kept.clear()
            self._kept[count] = self._repeated(count // len(self.which))
        return self._kept[count]

    @cached_property
    def _kept(self) -> dict[int, TreeLoops]:
        return {}

    def _repeated(self, repeat: int) -> TreeLoops:
        """Return the equations of all designs, one after another, so many times."""
        wide = {
            name: tuple(np.tile(array, repeat) for array in ends) for name, ends in self.arrays.ends.items()
        }
        tree = replace(self.tree)
        constants: dict[int, JointSides] = {}
        for branch in tree.branches:
            point_a, frame_a, point_b, frame_b = wide[branch.joint.name]
            a, b = (frame_a, point_a), (frame_b, point_b)
            constants[branch.child] = JointSides(*a, *b) if branch.forward else JointSides(*b, *a)
        # in place of what `cached_property` would find
        cached: dict[str, object] = vars(tree)
        cached["constants"] = constants
        cuts = tuple(_cut(cut, wide[cut.joint.name]) for cut in self.cuts)
        return TreeLoops(tree, cuts, self.turn_offsets, self.driven)


def _cut(cut: Cut, ends: tuple[Array, ...]) -> Cut:
    point_a, frame_a, point_b, frame_b = ends
    copy = replace(cut)
    cached: dict[str, object] = vars(copy)
    cached["ends"] = [(cut.sides[0], point_a, frame_a), (cut.sides[1], point_b, frame_b)]
    return copy


def assembled_designs(
    like: TreeLoops, started: StartedDesigns, rank: int
) -> tuple[DesignLoops, Coordinates, Bools]:
    """Return loops of designs, the coordinates in which they close nearest to their guesses, and which do.

    A design that closes otherwise than with the rank of the one they are like, with axes or marks opposed, or
    after other revolutions of coupled joints, counts as one that does not close.
    """
    arrays = started.arrays
    designs = DesignLoops(
        like.tree, like.cuts, like.turn_offsets, like.driven, arrays, np.arange(arrays.count)
    )
    guess = like.with_multi_turn(like.read(started.guess, arrays.sides()), started.coordinates)
    loops = designs.at_instants(arrays.count)
    result = newton(LoopSystem(loops, loops.unknown), guess, ASSEMBLY, least_norm)
    closed = (result.residual < CLOSED) & axes_aligned(loops, result.q)
    closed &= significant(np.linalg.svd(result.linearised.matrix, compute_uv=False)).sum(1) == rank
    for revolutions, offset in zip(like.revolutions_between(guess), like.turn_offsets, strict=True):
        closed &= revolutions == offset
    return designs, result.q, closed


# part of the designs that a longer step must suit
GROWTH_QUANTILE = 0.2


class Divided(Exception):  # noqa: N818
    """Designs cannot go on with the same segments.

    Attributes:
        subsets: of them that can, each with the length of its next segment.
    """

    def __init__(self, *subsets: tuple["DesignPaths", float]):
        self.subsets = subsets


class DesignPaths(ContinuationPath):
    """Assemblies of d designs followed with the same segments.

    A rejected segment costs only the designs that need shorter ones: they are divided from the others.
    """

    control = StepControl(min_length=4e-3, target_error=2e-5, target_correction=2e-2)
    overshoot = 0.0

    @property
    def designs(self) -> DesignLoops:
        """Their loops."""
        assert isinstance(self.loops, DesignLoops)
        return self.loops

    def select(self, which: Rows | Bools) -> "DesignPaths":
        """Return the paths of some of the designs."""
        loops = self.designs.select(np.arange(self.count)[which])
        solvers = {
            id(solver): replace(solver, loops=loops, reference=solver.reference.select(which))
            for solver in (self.first, *(each.solver for half in self.segments.values() for each in half))
        }
        subset = DesignPaths(solvers[id(self.first)], self.prescribed, self.initial, self.policy, self.words)
        subset.sign = self.sign[which]
        for direction, segments in self.segments.items():
            subset.segments[direction] = [
                replace(
                    segment,
                    states=segment.states.reshape(len(segment.nodes), self.count, -1)[:, which].reshape(
                        len(segment.nodes), -1
                    ),
                    solver=solvers[id(segment.solver)],
                    adequate=None if segment.adequate is None else segment.adequate[which],
                )
                for segment in segments
            ]
        return subset

    def accepted(self, segment: Segment, closed: ClosedNodes, direction: int) -> tuple[Segment | None, float]:
        """Return a segment, None if it is rejected for all designs, and the length to try next.

        Raises:
            Divided: if it is rejected for some of them.
        """
        if self.count == 1:
            return super().accepted(segment, closed, direction)
        step, segments = segment.length, self.segments[direction]
        signs = closed.linearised.determinant_sign.reshape(-1, self.count)
        # determinants of other rows have other signs
        same_rows = len(segments) > 0 and segments[-1].solver is segment.solver
        sign = np.where(same_rows & (self.sign != 0.0), self.sign, signs[0])
        error = closed.error
        valid = closed.valid & (error <= self.control.max_error) & (signs == sign).all(0)
        if not valid.any():
            return None, 0.5 * step
        growth = self.growth(step, direction, error, closed.displacement)[valid]
        longer = min(self.control.max_length, step * float(np.quantile(growth, GROWTH_QUANTILE)))
        segment = replace(segment, adequate=segment.solver.adequate(closed.linearised.last(self.count))[0])
        if valid.all():
            self.sign = sign
            return segment, longer
        rejected = self.select(~valid)
        segments.append(segment)
        kept = self.select(valid)
        kept.sign = sign[valid]
        raise Divided((kept, longer), (rejected, 0.5 * step))

    def _solver(self, current: float, direction: int) -> LoopSolver:
        adequate = self.segments[direction][-1].adequate if self.segments[direction] else None
        if self.count > 1 and adequate is not None and adequate.any() and not adequate.all():
            length = self.segments[direction][-1].length
            raise Divided((self.select(adequate), length), (self.select(~adequate), length))
        return super()._solver(current, direction)


def followed(paths: DesignPaths, targets: Sequence[float]) -> list[DesignPaths]:
    """Return designs followed to parameters, divided as they need; those that fail are left out."""
    finished = [paths]
    for target in targets:
        waiting: list[tuple[DesignPaths, float | None]] = [(path, None) for path in finished]
        finished = []
        while waiting:
            path, length = waiting.pop()
            try:
                path.reach(target, 1 if target > path.initial else -1, length)
            except Divided as divided:
                waiting += divided.subsets
            except AssemblyError:
                continue
            else:
                finished += [] if path.change_points else [path]
    return finished
