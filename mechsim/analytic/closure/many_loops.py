"""The loops of many designs alike: one tree, and for each design its own joints' places."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure.cut_rows import Cut
from mechsim.analytic.closure.spanning_tree import Fixed
from mechsim.analytic.closure.tree_loops import RANK_TOLERANCE, TreeLoops, tree_loops
from mechsim.analytic.closure.tree_motion import Coordinates, placed
from mechsim.maths.arrays import Array
from mechsim.model.joints import KINDS
from mechsim.model.mechanism import Mechanism
from mechsim.model.rough_poses import rough_poses, starts

Rows = NDArray[np.intp]
Bools = NDArray[np.bool_]
# as one mechanism is put together: Newton steps, the longest turn of one in [rad], a gap that is closed
MOST_STEPS, LONGEST, CLOSED = 60, 0.5, 1e-12


@dataclass(frozen=True)
class ManyLoops:
    """Loop equations of d designs that differ only in where their joints and points are.

    Attributes:
        loops: of one of them; lengths of all are counted in its size.
        ends: joint -> points (3, d) and frames (3, 3, d) of its sides a and b.
        points: tracked point -> (3, d) in its link's frame.
    """

    loops: TreeLoops
    ends: dict[str, tuple[Array, Array, Array, Array]]
    points: dict[str, Array]

    def of(self, rows: Rows, repeat: int) -> TreeLoops:
        """Return the loops of some designs at so many instants each, one design after another."""
        wide = {
            name: tuple(np.repeat(part[..., rows], repeat, -1) for part in parts)
            for name, parts in self.ends.items()
        }
        tree = replace(self.loops.tree)
        constants: dict[int, Fixed] = {}
        for branch in tree.branches:
            point_a, frame_a, point_b, frame_b = wide[branch.joint.name]
            a, b = (frame_a, point_a), (frame_b, point_b)
            constants[branch.far] = Fixed(*a, *b) if branch.forward else Fixed(*b, *a)
        # in place of what `cached_property` would find
        own: dict[str, object] = vars(tree)
        own["constants"] = constants
        cuts = tuple(_cut(cut, wide[cut.joint.name]) for cut in self.loops.cuts)
        return replace(self.loops, tree=tree, cuts=cuts)


def _cut(cut: Cut, ends: tuple[Array, ...]) -> Cut:
    point_a, frame_a, point_b, frame_b = ends
    found = replace(cut)
    own: dict[str, object] = vars(found)
    own["ends"] = [(cut.sides[0], point_a, frame_a), (cut.sides[1], point_b, frame_b)]
    return found


def alike(one: Mechanism, other: Mechanism) -> bool:
    """Whether two mechanisms differ only in where joints and points are, and in how they are guessed."""
    return (
        [link.name for link in one.links] == [link.name for link in other.links]
        and [_kind(joint) for joint in one.joints] == [_kind(joint) for joint in other.joints]
        and one.drivers == other.drivers
        and one.start == other.start
        and one.holds == other.holds
        and one.laws == other.laws
        and {name: link for name, (link, _) in one.points.items()}
        == {name: link for name, (link, _) in other.points.items()}
    )


def _kind(joint: object) -> tuple[object, ...]:
    return tuple(getattr(joint, name) for name in ("name", "kind", "cross_angle", "lead"))


def many_loops(loops: TreeLoops, designs: Sequence[Mechanism]) -> ManyLoops:
    """Return the loops of designs that are `alike`."""
    ends: dict[str, tuple[Array, Array, Array, Array]] = {}
    for i, joint in enumerate(loops.tree.mechanism.joints):
        sides = [[one.joints[i].a for one in designs], [one.joints[i].b for one in designs]]
        points = [np.array([end.point for end in side]).T for side in sides]
        frames = [np.moveaxis(np.array([end.frame for end in side]), 0, -1) for side in sides]
        ends[joint.name] = points[0], frames[0], points[1], frames[1]
    names = loops.tree.mechanism.points
    points = {name: np.array([one.points[name][1] for one in designs]).T for name in names}
    return ManyLoops(loops, ends, points)


def rough_coordinates(designs: Sequence[Mechanism]) -> Coordinates:
    """Return where the guesses of designs have them, (d) sets of coordinates."""
    found = [tree_loops(one, rough_poses(one), starts(one))[1] for one in designs]
    return Coordinates(
        np.concatenate([one.values for one in found], 1), np.concatenate([one.turns for one in found], -1)
    )


def put_together(many: ManyLoops, at: Coordinates, rank: int) -> tuple[Coordinates, Bools]:
    """Return the coordinates in which loops close nearest to some, and which designs closed, (d,).

    As `tree_assembly.closed` does for one; a design that closes otherwise than with the rank of the first, or
    with its axes opposed, counts as one that does not.
    """
    count = len(at)
    loops = many.of(np.arange(count), 1)
    before, gap = np.full(count, np.inf), np.full(count, np.inf)
    going = np.ones(count, dtype=np.bool_)
    unknown, known = loops.unknown, np.zeros(count, dtype=np.intp)
    for _ in range(MOST_STEPS):
        residual, slope, _ = loops.linearise(at)
        gap = np.where(going, np.abs(residual).max(0, initial=0.0), gap)
        going &= ~((gap == 0.0) | ((gap < CLOSED) & (gap > 0.25 * before)))
        matrix = slope[:, unknown].transpose(2, 0, 1)
        left, values, right = np.linalg.svd(matrix, full_matrices=False)
        tells = values > RANK_TOLERANCE * values[:, :1]
        known = tells.sum(1)
        if not going.any():
            break
        before = np.where(going, gap, before)
        inverse = np.where(tells, 1.0 / np.where(tells, values, 1.0), 0.0)
        asked = np.einsum("nrk,rn->nk", left, residual) * inverse
        step = np.zeros((loops.tree.count, count))
        step[unknown] = -np.einsum("nku,nk->un", right, asked)
        step *= LONGEST / np.maximum(LONGEST, np.abs(step).max(0, initial=0.0))
        at = loops.moved(at, np.where(going, step, 0.0))
    return at, (gap < CLOSED) & (known == rank) & _axes_alike(loops, at)


def _axes_alike(loops: TreeLoops, at: Coordinates) -> Bools:
    here, good = placed(loops.tree, at), np.ones(len(at), dtype=np.bool_)
    for cut in loops.cuts:
        _, frame_a, _, frame_b = cut.frames(here)
        if KINDS[cut.joint.kind].aligned:
            good &= (frame_a[:, 2] * frame_b[:, 2]).sum(0) > 0.0
    return good
