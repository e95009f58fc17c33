"""The loops of many designs alike: one tree, and for each design its own joints' places."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.assembly_errors import ASSEMBLY, CLOSED
from mechsim.analytic.loops.constraints import Cut, LoopSystem, TreeLoops
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.analytic.loops.random_starts import axes_aligned
from mechsim.analytic.loops.tree import JointSides
from mechsim.model.design_arrays import DesignArrays, StartedDesigns
from mechsim.numerics.arrays import Array
from mechsim.numerics.newton import newton
from mechsim.numerics.rank import least_norm, significant

Rows = NDArray[np.intp]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class ManyLoops:
    """Loop equations of d designs that differ only in where their joints and points are.

    Attributes:
        loops: of one of them; lengths of all are counted in its size.
        arrays: their numbers.
    """

    loops: TreeLoops
    arrays: DesignArrays

    def select(self, rows: Rows, repeat: int) -> TreeLoops:
        """Return the loops of some designs at so many instants each, one design after another."""
        wide = {
            name: tuple(np.repeat(ends[..., rows], repeat, -1) for ends in sides)
            for name, sides in self.arrays.ends.items()
        }
        tree = replace(self.loops.tree)
        constants: dict[int, JointSides] = {}
        for branch in tree.branches:
            point_a, frame_a, point_b, frame_b = wide[branch.joint.name]
            a, b = (frame_a, point_a), (frame_b, point_b)
            constants[branch.child] = JointSides(*a, *b) if branch.forward else JointSides(*b, *a)
        # in place of what `cached_property` would find
        cached: dict[str, object] = vars(tree)
        cached["constants"] = constants
        cuts = tuple(_cut(cut, wide[cut.joint.name]) for cut in self.loops.cuts)
        return replace(self.loops, tree=tree, cuts=cuts)


def _cut(cut: Cut, ends: tuple[Array, ...]) -> Cut:
    point_a, frame_a, point_b, frame_b = ends
    copy = replace(cut)
    cached: dict[str, object] = vars(copy)
    cached["ends"] = [(cut.sides[0], point_a, frame_a), (cut.sides[1], point_b, frame_b)]
    return copy


def initial_coordinates(many: ManyLoops, started: StartedDesigns) -> tuple[Coordinates, Bools]:
    """Return where guesses have designs, (d) sets of coordinates, and which wind as the one does, (d,).

    As `tree_loops` reads one.
    """
    loops = many.loops
    q = loops.with_multi_turn(loops.read(started.guess, started.arrays.sides()), started.coordinates)
    same_revolutions = np.ones(len(q), dtype=np.bool_)
    for revolutions, offset in zip(loops.revolutions_between(q), loops.turn_offsets, strict=True):
        same_revolutions &= revolutions == offset
    return q, same_revolutions


def assemble_designs(many: ManyLoops, q: Coordinates, rank: int) -> tuple[Coordinates, Bools]:
    """Return the coordinates in which loops close nearest to some, and which designs closed, (d,).

    As `tree_assembly.closed` does for one; a design that closes otherwise than with the rank of the first, or
    with axes or marks opposed, counts as one that does not.
    """
    loops = many.select(np.arange(len(q)), 1)
    result = newton(LoopSystem(loops, loops.unknown), q, ASSEMBLY, least_norm)
    ranks = significant(np.linalg.svd(result.linearised.matrix, compute_uv=False)).sum(1)
    return result.q, (result.residual < CLOSED) & (ranks == rank) & axes_aligned(loops, result.q)
