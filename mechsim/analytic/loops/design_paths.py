"""Many designs traced together along one path of their drivers, each in its own assembly.

As for one mechanism (`path`), the polynomial of a segment predicts the next, and all nodes of all designs
are corrected together. A segment is accepted for a design if the correction and the interpolation error are
small and the Jacobian determinant keeps its sign. A design whose segment is rejected continues with shorter
ones; a design that needs very short ones is left to be traced by itself.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.assembly_errors import ASSEMBLY
from mechsim.analytic.loops.constraints import Cut, LoopSystem, TreeLoops
from mechsim.analytic.loops.kinematics import Coordinates
from mechsim.analytic.loops.path_rates import FINAL, ClosedChunk, Instants
from mechsim.analytic.loops.path_segments import CLOSED, PathStates, Segment
from mechsim.analytic.loops.random_starts import axes_aligned
from mechsim.analytic.loops.solver import (
    MIN_VALUE_RATIO,
    NEARBY,
    LoopSolver,
    loop_solver,
)
from mechsim.analytic.loops.tree import JointSides
from mechsim.model.design_arrays import DesignArrays, StartedDesigns
from mechsim.numerics.arrays import Array
from mechsim.numerics.collocation import nodes_between
from mechsim.numerics.newton import newton
from mechsim.numerics.rank import least_norm, significant
from mechsim.numerics.step_control import StepControl

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


# as for one mechanism, with larger targets: a rejected segment costs only the designs that need shorter ones,
# and a design that needs segments shorter than the smallest length is traced by itself
CONTROL = StepControl(min_length=4e-3, target_error=2e-5, target_correction=2e-2)
# part of the designs that a longer step must suit
GROWTH_QUANTILE = 0.2
# instants closed in one go
CHUNK = 4096
# takes which designs, which of the angles, and their closed instants
Store = Callable[[Rows, Rows, ClosedChunk], None]
# parameters of a path (n,) -> what is prescribed and its first two derivatives, (driven, n) each
Law = Callable[[Array], tuple[Array, Array, Array]]


@dataclass(frozen=True)
class Group:
    """Designs that are followed with the same cells.

    Attributes:
        rows: which they are, (d,).
        reached: how far they were followed.
        step: length of the next cell.
        q: coordinates there, d sets.
        sign: sign of the loops' determinant, (d,); 0 where it is not known yet.
        picked: independent rows, by which they are solved.
        null_space: null-space basis over the unknowns, as of a link's spin, (nullity, unknowns).
        nodes: of the last cell; none before the first.
        states: there, (d, nodes, w).
    """

    rows: Rows
    reached: float
    step: float
    q: Coordinates
    sign: Array
    picked: Rows
    null_space: Array
    nodes: Array
    states: Array

    def select(self, which: Rows | Bools, **changed: object) -> "Group":
        """Return some of the designs."""
        q = Coordinates(self.q.values[:, which], self.q.turns[..., which])
        states = self.states[which] if len(self.nodes) else self.states
        group = replace(self, rows=self.rows[which], q=q, sign=self.sign[which], states=states)
        return replace(group, **changed)  # pyright: ignore[reportArgumentType]


class ManyPaths:
    """Designs followed along a path of their drivers, as over the angles of their crank.

    Attributes:
        many: their loops.
        law: of what is prescribed along the path.
        begin: parameter at which they begin.
        failed: which could not be followed together, so far.
    """

    def __init__(self, many: ManyLoops, law: Law, begin: float):
        self.many, self.law, self.begin = many, law, begin
        self.failed: list[Rows] = []

    def follow(self, rows: Rows, q: Coordinates, angles: Array, store: Store) -> Rows:
        """Follow designs to parameters of the path; return those that could not be followed together.

        Args:
            rows: which designs of the loops they are, (d,).
            q: where they stand at the beginning, (d) sets of coordinates.
            angles: (p,) in [rad].
            store: takes what was closed: each of the designs at each of some angles.
        """
        loops = self.many.select(rows[:1], 1)
        first = Coordinates(q.values[:, :1], q.turns[..., :1])
        solver, empty = loop_solver(loops, first), np.zeros(0)
        side = np.zeros(len(rows))
        group = Group(
            rows, self.begin, CONTROL.first_length, q, side, solver.rows, solver.null_space, empty, empty
        )
        for direction in (1.0, -1.0):
            indices = np.flatnonzero(direction * (angles - self.begin) >= (0.0 if direction > 0 else 1e-300))
            waiting = [group] if len(indices) else []
            while waiting:
                waiting += self._segment(waiting.pop(), direction, angles, indices, store)
        return np.unique(np.concatenate([*self.failed, np.zeros(0, dtype=np.intp)]))

    def _segment(
        self, group: Group, direction: float, angles: Array, indices: Rows, store: Store
    ) -> list[Group]:
        """Follow a group over one cell; return the groups that go on."""
        end_parameter = float((direction * angles[indices]).max()) * direction
        remaining = direction * (end_parameter - group.reached)
        if group.step < CONTROL.min_length:
            self.failed.append(group.rows)
            return []
        group, others = self._with_adequate_rows(group)
        if not len(group.rows):
            return others
        step = remaining if remaining <= group.step else min(group.step, 0.6 * remaining)
        step = max(step, 1e-6)
        nodes, weights = nodes_between(group.reached, group.reached + direction * step, CONTROL.nodes)
        try:
            states, valid, growths, side = self._closed(group, nodes)
        except np.linalg.LinAlgError:
            return [*others, *self._halved(group, step)]
        if not valid.all():
            others += self._halved(group.select(~valid), step)
            group, states = group.select(valid), states[valid]
            growths, side = growths[valid], side[valid]
            if not len(group.rows):
                return others
        reached = float(nodes[-1])
        rows = PathStates(self.many.select(group.rows, 1), self._prescribed)
        q = rows.unflat(states[:, -1], np.full(len(group.rows), reached))
        self._evaluate(group, Segment(nodes, states, weights, self._solver(group, 1)), angles, indices, store)
        if remaining <= step + 1e-12:
            return others
        growth = float(np.quantile(growths, GROWTH_QUANTILE))
        longer = min(CONTROL.max_length, growth * step)
        next_group = replace(group, reached=reached, step=longer, q=q, sign=side, nodes=nodes, states=states)
        return [*others, next_group]

    def _halved(self, group: Group, step: float) -> list[Group]:
        return [replace(group, step=0.5 * step)] if len(group.rows) else []

    def _prescribed(self, s: Array) -> Array:
        return self.law(s)[0]

    def _solver(self, group: Group, repeat: int) -> LoopSolver:
        loops = self.many.select(group.rows, repeat)
        pinned = Coordinates(np.repeat(group.q.values, repeat, 1), np.repeat(group.q.turns, repeat, -1))
        return LoopSolver(loops, group.picked, group.null_space, pinned)

    def _with_adequate_rows(self, group: Group) -> tuple[Group, list[Group]]:
        """Return the designs whose rows tell enough where they are, and the others with other rows."""
        undetermined = len(group.null_space) > 0
        if not undetermined and len(group.picked) == self.many.loops.rows:
            return group, []
        if undetermined:
            # what is left open turns with the links; it goes on as it was, and so do determinants' signs
            group = replace(group, null_space=self._solver_of_first(group, group.null_space).null_space)
        solver = self._solver(group, 1)
        linearised = solver.linearise(group.q)
        own = np.linalg.svd(linearised.matrix, compute_uv=False)[:, -1]
        all_values = np.linalg.svd(
            linearised.jacobian[:, solver.loops.unknown].transpose(2, 0, 1), compute_uv=False
        )
        adequate = own > MIN_VALUE_RATIO * all_values[:, len(group.picked) - 1]
        if adequate.all():
            return group, []
        rest = group.select(~adequate)
        replacement = self._solver_of_first(rest)
        unchanged = np.array_equal(replacement.rows, group.picked) and not (undetermined and adequate.any())
        if len(replacement.rows) != len(group.picked) or unchanged:
            self.failed.append(rest.rows)
            return group.select(adequate), []
        # determinants of other rows have other signs
        sign = np.zeros(len(rest.rows))
        return group.select(adequate), [
            replace(rest, picked=replacement.rows, null_space=replacement.null_space, sign=sign)
        ]

    def _solver_of_first(self, group: Group, before: Array | None = None) -> LoopSolver:
        """Return the solver of a group's first design where it stands."""
        first = group.select(np.arange(1))
        return loop_solver(self.many.select(first.rows, 1), first.q, before)

    def _closed(self, group: Group, nodes: Array) -> tuple[Array, Bools, Array, Array]:
        """Return states (d, nodes, w) closed there, which are good, by how much steps may grow, and sides."""
        count, k = len(group.rows), len(nodes)
        solver = self._solver(group, k)
        path = PathStates(solver.loops, self._prescribed)
        s = np.tile(nodes, count)
        q = path.unflat(self._predicted(group, nodes).reshape(count * k, -1), s)
        result = newton(solver, q, NEARBY)
        states = path.loops.flat(result.q).reshape(count, k, -1)
        shape = (count, k)
        residual = np.abs(result.linearised.residual).max(0, initial=0.0).reshape(shape).max(1)
        displacement = result.displacement.reshape(shape).max(1)
        signs = np.linalg.slogdet(result.linearised.matrix)[0].reshape(shape)
        half = nodes_between(0.0, 1.0, k // 2 + 1)[1]
        even = states[:, ::2].transpose(1, 0, 2).reshape(k // 2 + 1, -1)
        interpolated = (
            Segment(nodes[::2], even, half, solver).evaluate(nodes[1::2]).reshape(k // 2, count, -1)
        )
        error = np.abs(interpolated.transpose(1, 0, 2) - states[:, 1::2]).max((1, 2))
        sign = np.where(group.sign == 0.0, signs[:, 0], group.sign)
        same_sign = (signs == sign[:, None]).all(1)
        valid = (
            (residual < CLOSED)
            & (displacement < CONTROL.max_correction)
            & (error <= CONTROL.max_error)
            & same_sign
        )
        correction = displacement if len(group.nodes) else None
        ratio = float(np.ptp(group.nodes)) / float(np.ptp(nodes)) if len(group.nodes) else 1.0
        return states, valid, CONTROL.growth(error, correction, ratio), sign

    def _predicted(self, group: Group, nodes: Array) -> Array:
        """Return rough states at nodes, (d, nodes, w): by the cell before, or along the tangent."""
        count, k = len(group.rows), len(nodes)
        if len(group.nodes):
            weights = nodes_between(0.0, 1.0, len(group.nodes))[1]
            table = group.states.transpose(1, 0, 2).reshape(len(group.nodes), -1)
            predicted = Segment(
                group.nodes, table, weights, self._solver(group.select(np.arange(1)), 1)
            ).evaluate(nodes)
            return predicted.reshape(k, count, -1).transpose(1, 0, 2)
        solver = self._solver(group, k)
        loops = solver.loops
        start = Coordinates(np.repeat(group.q.values, k, 1), np.repeat(group.q.turns, k, -1))
        driven = list(loops.driven)
        step = np.zeros((loops.tree.count, count * k))
        advance = self._prescribed(np.tile(nodes, count)) - self._prescribed(np.array([group.reached]))
        step[driven] = advance / loops.units[driven, None]
        linearised = solver.linearise(start)
        rhs = np.zeros_like(linearised.rhs)
        rhs[:, : len(solver.rows)] = np.einsum("rkn,kn->nr", linearised.jacobian[solver.rows], step)
        moved = loops.displaced(start, step + solver.step(linearised.matrix, rhs))
        return loops.flat(moved).reshape(count, k, -1)

    def _evaluate(self, group: Group, segment: Segment, angles: Array, indices: Rows, store: Store) -> None:
        """Close the poses asked for in a cell and hand them on."""
        low, high = sorted((segment.nodes[0], segment.nodes[-1]))
        first_segment = not len(group.nodes)
        inside = (angles[indices] > low) & (angles[indices] <= high)
        if segment.nodes[-1] < segment.nodes[0]:
            inside = (angles[indices] >= low) & (angles[indices] < high)
        if first_segment:
            inside |= angles[indices] == segment.nodes[0]
        columns = indices[inside]
        step = max(1, CHUNK // max(1, len(columns)))
        for first in range(0, len(group.rows) if len(columns) else 0, step):
            chunk = group.select(np.arange(first, min(first + step, len(group.rows))))
            states = segment.states[first : first + step]
            self._poses(chunk, replace(segment, states=states), angles, columns, store)

    def _poses(self, group: Group, segment: Segment, angles: Array, columns: Rows, store: Store) -> None:
        count, p = len(group.rows), len(columns)
        table = segment.states.transpose(1, 0, 2).reshape(len(segment.nodes), -1)
        interpolated = (
            replace(segment, states=table).evaluate(angles[columns]).reshape(p, count, -1).transpose(1, 0, 2)
        )
        solver = self._solver(group, p)
        s = np.tile(angles[columns], count)
        q = PathStates(solver.loops, self._prescribed).unflat(interpolated.reshape(count * p, -1), s)
        result = newton(solver, q, FINAL)
        failed = np.isinf(result.displacement).reshape(count, p).any(1)
        if failed.any():
            self.failed.append(group.rows[failed])
        zero, rate = np.zeros_like(s), np.ones_like(s)
        instants = Instants(s, rate, zero, *self.law(s))
        store(
            group.rows, columns, ClosedChunk(solver, np.arange(len(s)), instants, result.q, result.linearised)
        )
