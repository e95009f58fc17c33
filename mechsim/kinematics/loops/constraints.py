"""The loop equations of a mechanism in the coordinates of its spanning tree: residuals and Jacobians.

The coordinates without driver are unknown. Of redundant equations, as in a planar linkage, only independent
ones are used; an additional equation keeps a passive rotation at its value.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mechsim.kinematics.loops.kinematics import (
    Coordinates,
    LinkPoses,
    carried_frame,
    carried_point,
    link_poses,
    matrix_product,
    on_ground,
)
from mechsim.kinematics.loops.tree import Indices, JointSides, SpanningTree, indices, spanning_tree
from mechsim.kinematics.vector_method.vectors import array_cross as cross
from mechsim.mechanism.joint_kinds import COLUMN, KINDS, coordinates
from mechsim.mechanism.joints import Coupling, Joint
from mechsim.mechanism.link_poses import rotated, with_virtual_bodies
from mechsim.mechanism.links import GROUND, IDENTITY, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import REVOLUTION, Array
from mechsim.numerics.loop_solver import LoopSolver

if TYPE_CHECKING:
    from mechsim.mechanism.design_arrays import Ends, Sides
    from mechsim.numerics.banded import SparseMatrices


@dataclass(frozen=True)
class Cut:
    """A joint that closes a loop.

    Attributes:
        joint: the joint.
        sides: indices of the links of its sides a and b; -1 is the ground.
        columns: coordinates that move only one side.
        gains: change of side b by one unit of each, in [m] or [rad]; negative for side a.
        length: characteristic length of the mechanism, in [m].
        one_sense: whether further equations, cosine = 1, keep a search away from antiparallel axes, which
            satisfy the others. At a solution their derivatives are zero.
        sides_of_designs: points and joint frames of both sides, (3, n) and (3, 3, n), if they are not those
            of the joint, as of many designs.
    """

    joint: Joint
    sides: tuple[int, int]
    columns: NDArray[np.intp]
    gains: Array
    length: float
    one_sense: bool = False
    sides_of_designs: Sides | None = None

    @cached_property
    def lengths(self) -> list[int]:
        """Columns of side a's frame along which the points must coincide."""
        free = {COLUMN[axis] for axis in KINDS[self.joint.kind].slides}
        return [i for i in range(3) if i not in free]

    @cached_property
    def directions(self) -> list[tuple[int, int, float]]:
        """(i, j, c): column i of a's frame and column j of b's frame have the scalar product c."""
        kind = KINDS[self.joint.kind]
        if kind.crossed:
            return [(2, 2, np.cos(self.joint.cross_angle))]
        if not kind.aligned:
            return []
        senses = [(i, i, 1.0) for i in kind.aligned_columns] if self.one_sense else []
        return [(0, 2, 0.0), (1, 2, 0.0), *([] if kind.turns else [(0, 1, 0.0)]), *senses]

    @cached_property
    def products(self) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array]:
        """Factors of each direction equation: columns of a's and b's frames, units, and required products.

        The last two are (rows, 1).
        """
        i, j = (np.array([pair[k] for pair in self.directions], dtype=np.intp) for k in (0, 1))
        lengths = len(self.lengths)
        units = np.repeat([1.0 / self.length, 1.0], [lengths, len(i)])[:, None]
        targets = np.array([0.0] * lengths + [pair[2] for pair in self.directions])[:, None]
        return np.array([*self.lengths, *i], dtype=np.intp), j, units, targets

    @cached_property
    def rows(self) -> int:
        """Number of equations."""
        return len(self.lengths) + len(self.directions) + KINDS[self.joint.kind].rod

    @cached_property
    def ends(self) -> list[tuple[int, Array, Array]]:
        """Link, point and joint frame of sides a and b, in the frames of the links."""
        if self.sides_of_designs is not None:
            point_a, frame_a, point_b, frame_b = self.sides_of_designs
            return [(self.sides[0], point_a, frame_a), (self.sides[1], point_b, frame_b)]
        ends = zip(self.sides, (self.joint.a, self.joint.b), strict=True)
        return [(link, np.array(end.point), end.frame) for link, end in ends]


@dataclass(frozen=True)
class CutBlock:
    """Cut joints of a group whose loops have as many coordinates.

    Attributes:
        which: the joints among those of the group, k.
        rows: their equations among all, (k, rows).
        columns: coordinates that move only one side of each, (k, columns).
        gains: change of side b by one unit of each, (k, 1, columns, 1).
    """

    which: Indices
    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    gains: Array

    @cached_property
    def entries(self) -> tuple[Any, Any]:
        """Rows and columns of their Jacobians among all."""
        if len(self.rows) == 1:
            return indices(self.rows[0].tolist()), self.columns[0]
        return self.rows[:, :, None], self.columns[:, None]

    def jacobian(self, wrench: Array, unit_twists: Array) -> Array:
        """Return Jacobians at `entries` from wrenches along the equations, (6, rows, m, n)."""
        along, moving = wrench[:, :, self.which], unit_twists.take(self.columns, 0)
        jacobian = np.einsum("irmn,mcin->mrcn", along, moving)
        jacobian *= self.gains
        return jacobian[0] if len(self.rows) == 1 else jacobian


@dataclass(frozen=True)
class CutGroup:
    """Cut joints of a kind, whose equations are evaluated together.

    Attributes:
        cuts: the joints, m.
        rows: their equations among all, (m, rows).
    """

    cuts: tuple[Cut, ...]
    rows: NDArray[np.intp]

    @cached_property
    def all_rows(self) -> Indices:
        """Their equations among all, joint by joint."""
        return indices(self.rows.ravel().tolist())

    @cached_property
    def blocks(self) -> list[CutBlock]:
        """The joints in blocks with as many columns each."""
        of_count: dict[int, list[int]] = {}
        for i, cut in enumerate(self.cuts):
            of_count.setdefault(len(cut.columns), []).append(i)
        return [
            CutBlock(
                indices(own),
                self.rows[own],
                np.stack([self.cuts[i].columns for i in own]),
                np.stack([self.cuts[i].gains for i in own])[:, None, :, None],
            )
            for own in of_count.values()
        ]

    @cached_property
    def _targets(self) -> Array:
        return np.stack([cut.products[3] for cut in self.cuts])

    @cached_property
    def _length(self) -> Array:
        """Lengths of rods, (m, 1) in [m]."""
        return np.array([[cut.joint.length] for cut in self.cuts])

    @cached_property
    def _ends(self) -> list[tuple[Indices | None, Array, Array]]:
        """Links of sides a and b, None for the ground, with their points and joint frames."""
        ends = zip(*(cut.ends for cut in self.cuts), strict=True)
        return [
            (
                None if side[0][0] < 0 else indices([link for link, _, _ in side]),
                np.stack([point for _, point, _ in side]),
                np.stack([frame for _, _, frame in side]),
            )
            for side in ends
        ]

    def frames(self, poses: LinkPoses) -> tuple[Array, Array, Array, Array]:
        """Return points (3, m, n) and joint frames (3, 3, m, n) of sides a and b."""
        sides: list[Array] = []
        for links, point, frame in self._ends:
            if links is None:
                rotated_frame, placed = on_ground(frame, point)
            else:
                rotation = poses.rotation[links]
                placed = poses.position[links] + carried_point(point, rotation)
                rotated_frame = carried_frame(frame, rotation)
            sides += [placed.swapaxes(0, 1), rotated_frame.transpose(1, 2, 0, 3)]
        return sides[0], sides[1], sides[2], sides[3]

    def residual_and_wrench(self, poses: LinkPoses) -> tuple[Array, Array]:
        """Return residuals (m, rows, n), and a wrench along each equation, whose power is their rate.

        Wrenches are (6, rows, m, n).
        """
        point_a, frame_a, point_b, frame_b = self.frames(poses)
        if KINDS[self.cuts[0].joint.kind].rod:
            return self._rod(point_a, point_b)
        columns_a, columns_b, units, _ = self.cuts[0].products
        k, shape = len(self.cuts[0].lengths), (len(self.cuts), poses.position.shape[2])
        directions_a = frame_a.take(columns_a, 1) * units[..., None]
        measured = np.empty((3, self.rows.shape[1], *shape), poses.position.dtype)
        measured[:, :k] = point_b[:, None]
        measured[:, k:] = frame_b.take(columns_b, 1)
        wrench = np.zeros((6, *measured.shape[1:]), measured.dtype)
        wrench[:3, :k] = directions_a[:, :k]
        wrench[3:] = cross(measured, directions_a)
        measured[:, :k] -= point_a[:, None]
        return np.einsum("irmn,irmn->mrn", directions_a, measured) - self._targets, wrench

    def _rod(self, point_a: Array, point_b: Array) -> tuple[Array, Array]:
        """Return residual and wrench of (D.D - L^2) / (2 L), with D from point a to point b."""
        length, unit = self._length, self.cuts[0].length
        gap = point_b - point_a
        along = gap / (length * unit)
        wrench = np.concatenate([along, cross(np.broadcast_to(point_b, gap.shape), along)])
        return (0.5 * ((gap * along).sum(0) - length / unit))[:, None], wrench[:, None]

    def velocity_products(self, poses: LinkPoses, twist: Array, velocity_product: Array) -> Array:
        """Return velocity-product terms of the residuals, (m, rows, n), from those of the links."""
        like = self.cuts[0]
        point_a, frame_a, point_b, frame_b = self.frames(poses)
        zero = np.zeros((6, 1, twist.shape[2]))
        (ta, tb), (da, db) = (
            [zero if links is None else values[links].swapaxes(0, 1) for links, _, _ in self._ends]
            for values in (twist, velocity_product)
        )
        wa, wb = ta[3:], tb[3:]
        if KINDS[like.joint.kind].rod:
            gap, rate = point_b - point_a, _velocity(tb, point_b) - _velocity(ta, point_a)
            bias = _acceleration(tb, db, point_b) - _acceleration(ta, da, point_a)
            return ((gap * bias + rate * rate).sum(0) / (self._length * like.length))[:, None]
        # relative to side a, of whose frame point b is a point for the moment
        relative = _acceleration(tb, db, point_b) - _acceleration(ta, da, point_b)
        relative = relative - 2.0 * cross(wa, _velocity(tb, point_b) - _velocity(ta, point_b))
        out = np.empty((*self.rows.shape, twist.shape[2]), twist.dtype)
        k = 0
        for i in like.lengths:
            out[:, k] = (frame_a[:, i] * relative).sum(0) / like.length
            k += 1
        for i, j, _ in like.directions:
            u, v = frame_a[:, i], frame_b[:, j]
            across, changing = cross(v, u), cross(cross(wb, v), u) + cross(v, cross(wa, u))
            out[:, k] = (across * (db[3:] - da[3:])).sum(0) + (changing * (wb - wa)).sum(0)
            k += 1
        return out


def _velocity(twist: Array, point: Array) -> Array:
    """Return the velocities of points of links, (3, m, n), whose twists are (6, m, n)."""
    return twist[:3] + cross(twist[3:], point)


def _acceleration(twist: Array, velocity_product: Array, point: Array) -> Array:
    """Return the velocity-product terms of the accelerations of points of links, (3, m, n)."""
    swing = cross(velocity_product[3:], point)
    return velocity_product[:3] + swing + cross(twist[3:], _velocity(twist, point))


def cuts_of(tree: SpanningTree) -> tuple[Cut, ...]:
    """Return the joints that close the loops of a tree."""
    cuts: list[Cut] = []
    zero = np.zeros(tree.count)
    for joint in tree.cuts:
        sides = tuple(-1 if end.link == GROUND else tree.index[end.link] for end in (joint.a, joint.b))
        moved = [zero if i < 0 else tree.moved_by[i] for i in sides]
        direction = moved[1] - moved[0]
        columns = np.flatnonzero(direction)
        gains = (direction * tree.units)[columns]
        cuts.append(Cut(joint, (sides[0], sides[1]), columns, gains, tree.length))
    return tuple(cuts)


@dataclass(frozen=True)
class CoupledRow:
    """The equation of a coupling: left - zeros[0] - p(right - zeros[1]) = 0.

    Attributes:
        coupling: the coupling.
        left_weights: weights of the coordinates on its left side, (count,).
        right_weights: weights of the coordinates on its right side, (count,).
        unit: unit of the residual: 1 rad, or the characteristic length in [m] if the left side is a length.
    """

    coupling: Coupling
    left_weights: Array
    right_weights: Array
    unit: float

    @property
    def turns(self) -> bool:
        """Whether its sides may differ by whole revolutions."""
        return self.coupling.turns

    def evaluate(self, values: Array) -> tuple[Array, Array, Array]:
        """Return residuals (n,) in its unit, derivatives by the coordinates (count, n) and p'' (n,)."""
        value, first, second = self.coupling.polynomial(self.right_weights @ values)
        residual = (self.left_weights @ values - self.coupling.zeros[0] - value) / self.unit
        jacobian = (self.left_weights[:, None] - self.right_weights[:, None] * first) / self.unit
        return residual, jacobian, second

    def velocity_products(self, values: Array, rates: Array) -> Array:
        """Return the velocity-product terms of the residuals for rates (count, n), (n,)."""
        return -self.evaluate(values)[2] * (self.right_weights @ rates) ** 2 / self.unit


def coupled_rows(tree: SpanningTree) -> tuple[CoupledRow, ...]:
    """Return the equations of all couplings of a mechanism."""
    rows: list[CoupledRow] = []
    for law in tree.mechanism.laws:
        left_weights, right_weights = (tree.coupled(terms) for terms in (law.left_terms, law.right_terms))
        has_length = bool(np.any(tree.slides & (left_weights != 0.0)))
        rows.append(CoupledRow(law, left_weights, right_weights, tree.length if has_length else 1.0))
    return tuple(rows)


@dataclass(frozen=True)
class TreeLoops:
    """The loop equations of a mechanism in the coordinates of a spanning tree.

    Attributes:
        tree: the spanning tree.
        cuts: the joints that close its loops.
        turn_offsets: whole revolutions between the sides of each coupling in the assembly, in [rad].
        driven: indices of the prescribed coordinates.
    """

    tree: SpanningTree
    cuts: tuple[Cut, ...]
    turn_offsets: tuple[float, ...]
    driven: tuple[int, ...]

    @cached_property
    def unknown(self) -> NDArray[np.intp]:
        """Indices of the unknown coordinates."""
        return np.delete(np.arange(self.tree.count), self.driven)

    @cached_property
    def units(self) -> Array:
        """Unit of each coordinate in the equations."""
        return self.tree.units

    @cached_property
    def couplings(self) -> tuple[CoupledRow, ...]:
        """The equations of the couplings."""
        return coupled_rows(self.tree)

    @cached_property
    def rows(self) -> int:
        """Number of equations."""
        return sum(cut.rows for cut in self.cuts) + len(self.turn_offsets)

    @cached_property
    def groups(self) -> list[CutGroup]:
        """The cut joints in groups."""
        groups, k = dict[tuple[object, ...], list[tuple[Cut, range]]](), 0
        for cut in self.cuts:
            many, (a, b) = cut.sides_of_designs is not None, cut.sides
            key = cut.joint.kind, cut.one_sense, a < 0, b < 0, many
            groups.setdefault(key, []).append((cut, range(k, k + cut.rows)))
            k += cut.rows
        return [
            CutGroup(tuple(cut for cut, _ in own), np.array([rows for _, rows in own], dtype=np.intp))
            for own in groups.values()
        ]

    @property
    def name(self) -> str:
        """Name of the mechanism."""
        return self.tree.mechanism.name

    @property
    def count(self) -> int:
        """Number of coordinates."""
        return self.tree.count

    def at_instants(self, _: int, /) -> TreeLoops:
        """Return the equations for a number of instants; those of a single mechanism do not depend on it."""
        return self

    def linearise(self, q: Coordinates, poses: LinkPoses | None = None) -> tuple[Array, Array, LinkPoses]:
        """Return residuals (rows, n), Jacobians by coordinates in units (rows, count, n), and link poses."""
        poses = link_poses(self.tree, q) if poses is None else poses
        jacobian = np.zeros((self.rows, self.tree.count, len(q)), q.values.dtype)
        residual, blocks = self._evaluated(q, poses)
        for entries, block in blocks:
            jacobian[entries] = block
        return residual, jacobian, poses

    def sparse(self, q: Coordinates) -> tuple[Array, SparseMatrices, LinkPoses]:
        """Return residuals, Jacobians and link poses as `linearise`."""
        from mechsim.numerics.banded import SparseMatrices

        poses = link_poses(self.tree, q)
        residual, blocks = self._evaluated(q, poses)
        values = np.concatenate([block.reshape(-1, len(q)) for _, block in blocks])
        return residual, SparseMatrices(*self._entries, values, (self.rows, self.count)), poses

    @cached_property
    def _entries(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of the entries of `sparse`."""
        blocks = [(block.rows, block.columns) for group in self.groups for block in group.blocks]
        blocks += [(np.array([[k]]), columns[None]) for k, columns in self._coupled]
        pairs = [np.broadcast_arrays(rows[:, :, None], columns[:, None]) for rows, columns in blocks]
        rows, columns = (np.concatenate([pair[i].ravel() for pair in pairs]) for i in (0, 1))
        return rows, columns

    @cached_property
    def _coupled(self) -> list[tuple[int, NDArray[np.intp]]]:
        """Equation of each coupling, and the coordinates in it."""
        weights = [(row.left_weights != 0.0) | (row.right_weights != 0.0) for row in self.couplings]
        return [(k, np.flatnonzero(own)) for k, own in enumerate(weights, self.rows - len(weights))]

    def _evaluated(self, q: Coordinates, poses: LinkPoses) -> tuple[Array, list[tuple[Any, Array]]]:
        """Return residuals (rows, n), and blocks of the Jacobian with their rows and columns."""
        residual = np.empty((self.rows, len(q)), q.values.dtype)
        blocks: list[tuple[Any, Array]] = []
        for group in self.groups:
            own, wrench = group.residual_and_wrench(poses)
            residual[group.all_rows] = own.reshape(group.rows.size, own.shape[2])
            blocks += [(each.entries, each.jacobian(wrench, poses.unit_twists)) for each in group.blocks]
        for coupling, offset, (k, columns) in zip(
            self.couplings, self.turn_offsets, self._coupled, strict=True
        ):
            violation, derivative, _ = coupling.evaluate(q.values)
            residual[k] = violation - offset / coupling.unit
            blocks.append(((k, columns), derivative[columns] * self.units[columns, None]))
        return residual, blocks

    def velocity_products(
        self, q: Coordinates, poses: LinkPoses, rates: Array, twist: Array, velocity_product: Array
    ) -> Array:
        """Return the velocity-product terms of the residuals for coordinate rates (count, n), (rows, n)."""
        out = np.empty((self.rows, len(q)), twist.dtype)
        for group in self.groups:
            terms = group.velocity_products(poses, twist, velocity_product)
            out[group.all_rows] = terms.reshape(group.rows.size, len(q))
        for k, coupling in enumerate(self.couplings, self.rows - len(self.turn_offsets)):
            out[k] = coupling.velocity_products(q.values, rates)
        return out

    def displaced(self, q: Coordinates, step: Array) -> Coordinates:
        """Return coordinates displaced by a step (count, n) in their units."""
        values, rotations = q.values + step * self.units[:, None], q.turns
        if len(rotations):
            values[self.tree.ball_indices] = 0.0
            rotations = np.stack(
                [
                    _rotated(rotation, step[ball.first_angle : ball.first_angle + 3])
                    for rotation, ball in zip(rotations, self.tree.balls, strict=True)
                ]
            )
        return Coordinates(values, rotations)

    def flat(self, q: Coordinates) -> Array:
        """Return coordinates as rows of numbers without units, (n, w)."""
        return np.concatenate([(q.values / self.units[:, None]).T, q.turns.reshape(-1, len(q)).T], 1)

    def unflat(self, rows: Array, driven: Array) -> Coordinates:
        """Return coordinates from rows of approximate numbers, and the driven ones, (driven, n)."""
        k = self.tree.count
        rotations = np.ascontiguousarray(rows[:, k:].T).reshape(-1, 3, 3, len(rows))
        if len(rotations):
            rotations = np.stack([orthogonal(orthogonal(rotation)) for rotation in rotations])
        values = rows[:, :k].T * self.units[:, None]
        values[list(self.driven)] = driven
        return Coordinates(values, rotations)

    def along(self, q: Coordinates, reference: Coordinates, directions: Array) -> tuple[Array, Array]:
        """Return displacements along directions (k, u), (n, k), and their derivatives (n, k, u)."""
        displacement = ((q.values - reference.values) / self.units[:, None])[self.unknown]
        offsets = (directions @ displacement).T
        rows = np.empty((len(q), *directions.shape), q.values.dtype)
        rows[:] = directions
        for ball, rotation, other in zip(self.tree.balls, q.turns, reference.turns, strict=True):
            columns = np.searchsorted(self.unknown, ball.first_angle) + np.arange(3)
            relative = matrix_product(rotation, other.transpose(1, 0, 2))
            vector = 0.5 * (relative - relative.transpose(1, 0, 2))[[2, 0, 1], [1, 2, 0]]
            offsets += (directions[:, columns] @ vector).T
            trace = np.einsum("iin->n", relative)
            change = 0.5 * (trace * np.eye(3)[..., None] - relative)
            rows[..., columns] = np.einsum("pi,ijn->npj", directions[:, columns], change)
        return offsets, rows

    def read(self, poses: Mapping[str, Pose], sides: Mapping[str, Sides] | None = None) -> Coordinates:
        """Return the coordinates of n poses of every moving link; angles in (-pi, pi].

        Args:
            poses: moving link -> one pose or n poses.
            sides: joint -> points (n, 3) and frames (n, 3, 3) of its sides a and b in their links, if they
                differ between poses; the default is those of the mechanism.
        """
        known_poses = {GROUND: IDENTITY, **with_virtual_bodies(self.tree.mechanism, poses)}
        n = max(pose.position.size // 3 for pose in known_poses.values())
        values, rotations = np.zeros((self.tree.count, n)), np.empty((len(self.tree.balls), 3, 3, n))
        ball = 0
        for branch in self.tree.branches:
            joint = branch.joint
            point_a, frame_a, point_b, frame_b = (
                (np.array(joint.a.point), joint.a.frame, np.array(joint.b.point), joint.b.frame)
                if sides is None
                else sides[joint.name]
            )
            a, b = known_poses[joint.a.link], known_poses[joint.b.link]
            rotation_a, rotation_b = a.rotation @ frame_a, b.rotation @ frame_b
            gap = b.position + rotated(b.rotation, point_b) - a.position - rotated(a.rotation, point_a)
            if branch.kind.ball:
                relative = np.swapaxes(rotation_a, -1, -2) @ rotation_b
                rotations[ball] = np.moveaxis(relative.reshape(-1, 3, 3), 0, -1)
                ball += 1
            joint_values = coordinates(branch.kind, gap, rotation_a, rotation_b, joint.cross_angle)
            rows = slice(branch.first, branch.first + joint_values.shape[-1])
            values[rows] = np.atleast_2d(joint_values).T
        return Coordinates(values, rotations)

    def with_multi_turn(self, q: Coordinates, values: Mapping[str, float | Array]) -> Coordinates:
        """Return coordinates with given values, and other angles in the corresponding revolution."""
        tree, out = self.tree, q.values.copy()
        prescribed = {*tree.mechanism.drivers, *tree.mechanism.locked}
        for name, value in values.items():
            index = tree.index_of.get(name)
            if index is not None and name in prescribed:
                out[index] = value
            elif index is not None and not tree.slides[index]:
                out[index] += REVOLUTION * np.round((value - out[index]) / REVOLUTION)
        return Coordinates(out, q.turns)

    def revolutions_between(self, q: Coordinates) -> list[Array]:
        """Return the whole revolutions between the sides of each coupling, (n,) in [rad]."""
        return [
            REVOLUTION * np.round(row.evaluate(q.values)[0] * row.unit / REVOLUTION) * row.turns
            for row in self.couplings
        ]


# what solves the loop equations about a configuration
TreeSolver: TypeAlias = LoopSolver[TreeLoops, Coordinates]


def tree_loops(
    mechanism: Mechanism, poses: Mapping[str, Pose], guess_coordinates: Mapping[str, float]
) -> tuple[TreeLoops, Coordinates]:
    """Return the loop equations of a mechanism and the coordinates of its poses.

    Args:
        mechanism: the mechanism.
        poses: pose of every moving link, closed or nearly so.
        guess_coordinates: coordinate -> value, for coordinates that poses do not determine: whole revolutions
            of angles, and exact values of drivers and locked coordinates.
    """
    tree = spanning_tree(mechanism)
    driven = tuple(tree.index_of[name] for name in (*mechanism.drivers, *mechanism.locked))
    loops = TreeLoops(tree, cuts_of(tree), (), driven)
    q = loops.with_multi_turn(loops.read(poses), guess_coordinates)
    offsets = tuple(float(offset[0]) for offset in loops.revolutions_between(q))
    return replace(loops, turn_offsets=offsets), q


def with_sides(loops: TreeLoops, sides: Mapping[str, Ends]) -> TreeLoops:
    """Return loops in which the sides of some joints vary by instant: points (3, n) and frames (3, 3, n)."""
    constants = {**loops.tree.constants}
    for branch in loops.tree.branches:
        if branch.joint.name in sides:
            point_a, frame_a, point_b, frame_b = sides[branch.joint.name]
            a, b = (frame_a, point_a), (frame_b, point_b)
            constants[branch.child] = JointSides(*a, *b) if branch.forward else JointSides(*b, *a)
    cuts = tuple(
        replace(cut, sides_of_designs=sides.get(cut.joint.name, cut.sides_of_designs)) for cut in loops.cuts
    )
    return TreeLoops(replace(loops.tree, sides=constants), cuts, loops.turn_offsets, loops.driven)


def axis_cosines(loops: TreeLoops, poses: LinkPoses) -> Iterator[tuple[str, int, Array]]:
    """Yield cut joints, columns of their frames that must be aligned, and the cosines between them, (n,).

    The equations require parallel directions, of either sign.
    """
    cosines: dict[str, list[tuple[str, int, Array]]] = {cut.joint.name: [] for cut in loops.cuts}
    for group in loops.groups:
        _, frame_a, _, frame_b = group.frames(poses)
        for i in KINDS[group.cuts[0].joint.kind].aligned_columns:
            for cut, own in zip(group.cuts, (frame_a[:, i] * frame_b[:, i]).sum(0), strict=True):
                cosines[cut.joint.name].append((cut.joint.name, i, own))
    for own in cosines.values():
        yield from own


def axes_aligned(loops: TreeLoops, q: Coordinates) -> NDArray[np.bool_]:
    """Return which of n configurations have no cut joint with antiparallel axes or references, (n,)."""
    aligned = np.ones(len(q), dtype=np.bool_)
    for _, _, cosine in axis_cosines(loops, link_poses(loops.tree, q)):
        aligned &= cosine > 0.0
    return aligned


def _rotated(rotation: Array, vector: Array) -> Array:
    """Return exp(vector) @ rotation, (3, 3, n), orthonormal to rounding."""
    angle = np.sqrt((vector**2).sum(0))
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0, np.sin(safe) / safe)
    b = np.where(small, 0.5, 2.0 * (np.sin(0.5 * safe) / safe) ** 2)
    first_order = cross(vector[:, None], rotation)
    rotated = rotation + a * first_order + b * cross(vector[:, None], first_order)
    return orthogonal(rotated)


def orthogonal(rotation: Array) -> Array:
    """Return nearly orthogonal matrices (3, 3, n) after a Newton step to the nearest rotations."""
    return 1.5 * rotation - 0.5 * matrix_product(
        rotation, matrix_product(rotation.transpose(1, 0, 2), rotation)
    )
