"""The loops of many designs alike: one tree, and for each design its own joints' places."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure.cut_rows import Cut
from mechsim.analytic.closure.random_starts import axes_alike
from mechsim.analytic.closure.telling import telling
from mechsim.analytic.closure.tree_joints import Fixed
from mechsim.analytic.closure.tree_loops import TreeLoops
from mechsim.analytic.closure.tree_motion import Coordinates
from mechsim.maths.angles import TURN
from mechsim.maths.arrays import Array
from mechsim.model.design_arrays import DesignArrays, StartedDesigns
from mechsim.model.joint_kinds import coordinates
from mechsim.model.links import GROUND, IDENTITY
from mechsim.model.rough_poses import turned

Rows = NDArray[np.intp]
Bools = NDArray[np.bool_]
# as one mechanism is put together: Newton steps, the longest turn of one in [rad], a gap that is closed
MOST_STEPS, LONGEST, CLOSED = 60, 0.5, 1e-12


@dataclass(frozen=True)
class ManyLoops:
    """Loop equations of d designs that differ only in where their joints and points are.

    Attributes:
        loops: of one of them; lengths of all are counted in its size.
        arrays: their numbers.
    """

    loops: TreeLoops
    arrays: DesignArrays

    def of(self, rows: Rows, repeat: int) -> TreeLoops:
        """Return the loops of some designs at so many instants each, one design after another."""
        wide = {
            name: tuple(np.repeat(part[..., rows], repeat, -1) for part in parts)
            for name, parts in self.arrays.ends.items()
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


def rough_coordinates(many: ManyLoops, started: StartedDesigns) -> tuple[Coordinates, Bools]:
    """Return where guesses have designs, (d) sets of coordinates, and which wind as the one does, (d,).

    As `tree_loops` reads one.
    """
    loops, arrays = many.loops, started.arrays
    tree, sides = loops.tree, arrays.sides()
    everywhere = {GROUND: IDENTITY, **started.guess}
    values = np.zeros((tree.count, arrays.count))
    turns = np.empty((len(tree.balls), 3, 3, arrays.count))
    ball = 0
    for branch in tree.branches:
        joint = branch.joint
        point_a, frame_a, point_b, frame_b = sides[joint.name]
        a, b = everywhere[joint.a.link], everywhere[joint.b.link]
        turn_a, turn_b = a.rotation @ frame_a, b.rotation @ frame_b
        gap = b.position + turned(b.rotation, point_b) - a.position - turned(a.rotation, point_a)
        if branch.kind.ball:
            turns[ball] = np.moveaxis(np.swapaxes(turn_a, -1, -2) @ turn_b, 0, -1)
            ball += 1
        found = coordinates(branch.kind, gap, turn_a, turn_b, joint.cross_angle)
        values[branch.first : branch.first + found.shape[1]] = found.T
    prescribed = {*tree.mechanism.drivers, *tree.mechanism.locked}
    for name, value in started.told.items():
        place = tree.places.get(name)
        if place is None:
            continue
        laps = 0.0 if tree.slides[place] else TURN * np.round((value - values[place]) / TURN)
        values[place] = value if name in prescribed else values[place] + laps
    alike = np.ones(arrays.count, dtype=np.bool_)
    for row, wind in zip(loops.couplings, loops.winds, strict=True):
        if row.turns:
            alike &= TURN * np.round(row.look(values)[0] * row.unit / TURN) == wind
    return Coordinates(values, turns), alike


def put_together(many: ManyLoops, at: Coordinates, rank: int) -> tuple[Coordinates, Bools]:
    """Return the coordinates in which loops close nearest to some, and which designs closed, (d,).

    As `tree_assembly.closed` does for one; a design that closes otherwise than with the rank of the first, or
    with axes or marks opposed, counts as one that does not.
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
        tells = telling(values)
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
    return at, (gap < CLOSED) & (known == rank) & axes_alike(loops, at)
