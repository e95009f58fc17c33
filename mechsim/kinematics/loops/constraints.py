"""The loop equations of a mechanism in the coordinates of its spanning tree: residuals and Jacobians.

The coordinates without driver are unknown. Of redundant equations, as in a planar linkage, only independent
ones are used; an additional equation keeps a passive rotation at its value.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mechsim.kinematics.loops import kinematics
from mechsim.kinematics.loops.kinematics import Coordinates, LinkPoses, axial, link_poses, matrix_product
from mechsim.kinematics.loops.tree import Indices, SpanningTree, indices, spanning_tree
from mechsim.kinematics.vector_method.vectors import array_cross as cross
from mechsim.mechanism.joint_kinds import COLUMN, KINDS, coordinates
from mechsim.mechanism.joints import Coupling, Joint, Sides
from mechsim.mechanism.link_poses import (
    guessed_poses,
    initial_coordinates,
    rotated,
    with_virtual_bodies,
)
from mechsim.mechanism.links import GROUND, IDENTITY, Pose
from mechsim.mechanism.mechanism import Mechanism
from mechsim.numerics.arrays import REVOLUTION, Array, polynomial
from mechsim.numerics.loop_solver import LoopSolver

if TYPE_CHECKING:
    from mechsim.mechanism.design_arrays import Ends
    from mechsim.numerics.banded import Band, SparseMatrices
    from mechsim.numerics.damped_band import NormalBand


@dataclass(frozen=True)
class Cut:
    """A joint that closes a loop.

    Attributes:
        joint: the joint.
        sides: indices of the links of its sides a and b; -1 is the ground.
        columns: coordinates that move only one side.
        gains: change of side b by one unit of each, in [m] or [rad]; negative for side a.
        length: characteristic length of the mechanism, in [m].
        ends: points and joint frames of both sides, as `Joint.sides`; of many designs (3, n) and (3, 3, n).
        one_sense: whether further equations, cosine = 1, keep a search away from antiparallel axes, which
            satisfy the others. At a solution their derivatives are zero.
    """

    joint: Joint
    sides: tuple[int, int]
    columns: NDArray[np.intp]
    gains: Array
    length: float
    ends: Sides
    one_sense: bool = False

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
    def _sides(self) -> list[tuple[Indices | None, Array, Array]]:
        """Links of sides a and b, None for the ground, with their points and joint frames."""
        point_a, frame_a, point_b, frame_b = map(np.stack, zip(*(cut.ends for cut in self.cuts), strict=True))
        a, b = (
            None if links[0] < 0 else indices(links)
            for links in zip(*(cut.sides for cut in self.cuts), strict=True)
        )
        return [(a, point_a, frame_a), (b, point_b, frame_b)]

    def frames(self, poses: LinkPoses) -> tuple[Array, Array, Array, Array]:
        """Return points (3, m, n) and joint frames (3, 3, m, n) of sides a and b."""
        sides: list[Array] = []
        for links, point, frame in self._sides:
            if links is None:
                rotated_frame, placed = kinematics.on_ground(frame, point)
            else:
                rotation = poses.rotation[links]
                placed = poses.position[links] + kinematics.carried_point(point, rotation)
                rotated_frame = kinematics.carried_frame(frame, rotation)
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
            [zero if links is None else values[links].swapaxes(0, 1) for links, _, _ in self._sides]
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
        columns_a, columns_b, _, _ = like.products
        k = len(like.lengths)
        out = np.empty((self.rows.shape[1], *relative.shape[1:]), twist.dtype)
        out[:k] = (frame_a.take(columns_a[:k], 1) * relative[:, None]).sum(0) / like.length
        u, v = frame_a.take(columns_a[k:], 1), frame_b.take(columns_b, 1)
        wa, wb = wa[:, None], wb[:, None]
        across, changing = cross(v, u), cross(cross(wb, v), u) + cross(v, cross(wa, u))
        out[k:] = (across * (db - da)[3:, None]).sum(0) + (changing * (wb - wa)).sum(0)
        return out.swapaxes(0, 1)


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
    moved = np.vstack([tree.moved_by, np.zeros(tree.count)])  # the ground, index -1, is last
    for joint in tree.cuts:
        a, b = (-1 if link == GROUND else tree.index[link] for link in joint.links)
        direction = moved[b] - moved[a]
        columns = np.flatnonzero(direction)
        gains = (direction * tree.units)[columns]
        cuts.append(Cut(joint, (a, b), columns, gains, tree.length, joint.sides))
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
    def has_revolutions(self) -> bool:
        """Whether its sides may differ by whole revolutions."""
        return self.coupling.turns and self.unit == 1.0


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
            (a, b), many = cut.sides, cut.ends[0].ndim
            key = cut.joint.kind, cut.one_sense, a < 0, b < 0, many
            groups.setdefault(key, []).append((cut, range(k, k + cut.rows)))
            k += cut.rows
        return [
            CutGroup(tuple(cut for cut, _ in own), np.array([rows for _, rows in own], dtype=np.intp))
            for own in groups.values()
        ]

    @cached_property
    def gap_rows(self) -> list[tuple[Cut, slice]]:
        """The cut joints, each with its equations of lengths, the first of its own."""
        ends = np.cumsum([0, *(cut.rows for cut in self.cuts)]).tolist()
        return [(cut, slice(k, k + len(cut.lengths))) for cut, k in zip(self.cuts, ends, strict=False)]

    @property
    def row_names(self) -> list[str]:
        """Joint or coupling of each equation."""
        joints = [cut.joint.name for cut in self.cuts for _ in range(cut.rows)]
        return joints + [row.coupling.name for row in self.couplings]

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
        for entries, block in zip(self._entries, blocks, strict=True):
            jacobian[entries] = block
        return residual, jacobian, poses

    def sparse(
        self, q: Coordinates, poses: LinkPoses | None = None
    ) -> tuple[Array, SparseMatrices, LinkPoses]:
        """Return residuals, Jacobians and link poses as `linearise`."""
        from mechsim.numerics.banded import SparseMatrices

        poses = link_poses(self.tree, q) if poses is None else poses
        residual, blocks = self._evaluated(q, poses)
        # free bodies have no equations
        values = np.concatenate([np.zeros((0, len(q))), *(block.reshape(-1, len(q)) for block in blocks)])
        return residual, SparseMatrices(*self._positions, values, (self.rows, self.count)), poses

    @cached_property
    def _positions(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Row and column of each entry of a sparse Jacobian, (e,) each."""
        none = np.zeros(0, np.intp)
        pairs = [(none, none), *(np.broadcast_arrays(*entries) for entries in self._entries)]
        rows, columns = (np.concatenate([pair[i].ravel() for pair in pairs]) for i in (0, 1))
        return rows, columns

    @cached_property
    def normal_band(self) -> NormalBand | None:
        """Order in which the normal equations of the unknowns are banded; None for a wide band."""
        from mechsim.numerics.banded import SparseMatrices
        from mechsim.numerics.damped_band import normal_band

        rows, columns = self._positions
        pattern = SparseMatrices(rows, columns, np.empty((len(rows), 0)), (self.rows, self.count))
        return normal_band(pattern, self.unknown)

    @cached_property
    def one_sense(self) -> TreeLoops:
        """The equations with residuals that vanish for parallel axes of one sense only."""
        return replace(self, cuts=tuple(replace(cut, one_sense=True) for cut in self.cuts))

    @cached_property
    def bands(self) -> dict[bytes, tuple[NDArray[np.intp], Band | None]]:
        """Orders of equations and unknowns that `sparse_loops` has computed."""
        return {}

    @cached_property
    def _entries(self) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
        """Rows and columns of each block of the Jacobian: those of cut joints, then those of couplings."""
        blocks = [block for group in self.groups for block in group.blocks]
        entries = [(block.rows[:, :, None], block.columns[:, None]) for block in blocks]
        if self.couplings:
            left, right = self._weights
            rows, columns = np.nonzero((left != 0.0) | (right != 0.0))
            entries.append((rows + self.rows - len(self.couplings), columns))
        return entries

    @cached_property
    def _weights(self) -> Array:
        """Weights of the coordinates on the left and the right sides of the couplings, (2, k, count)."""
        weights = [[row.left_weights, row.right_weights] for row in self.couplings]
        return np.reshape(weights, (len(weights), 2, self.count)).swapaxes(0, 1)

    @cached_property
    def _laws(self) -> list[tuple[NDArray[np.intp] | int, Callable[[Array], tuple[Array, Array, Array]]]]:
        """Indices of couplings and their p, p' and p'': functions, and polynomials of a degree together."""
        laws: list[tuple[NDArray[np.intp] | int, Callable[[Array], tuple[Array, Array, Array]]]] = []
        alike = dict[int, list[int]]()
        for i, row in enumerate(self.couplings):
            if row.coupling.function:
                laws.append((i, row.coupling.function))
            else:
                alike.setdefault(len(row.coupling.coefficients), []).append(i)
        for which in alike.values():
            coefficients = np.array([self.couplings[i].coupling.coefficients for i in which]).T[..., None]
            laws.append((np.array(which), partial(polynomial, coefficients)))
        return laws

    @cached_property
    def _zeros_and_units(self) -> Array:
        """Zero positions of the left and the right side of each coupling, and its unit, (3, k, 1)."""
        return np.reshape([[*row.coupling.zeros, row.unit] for row in self.couplings], (-1, 3)).T[..., None]

    def coupled(self, values: Array) -> tuple[Array, Array, Array]:
        """Return residuals of the couplings, without revolutions, p' and p'' at coordinates (count, n).

        They are (k, n) each: left - zeros[0] - p(right - zeros[1]) in the unit of each.
        """
        (left, right), (left_zeros, right_zeros, units) = self._weights, self._zeros_and_units
        offset, gap = right @ values - right_zeros, left @ values - left_zeros
        first, second = np.empty_like(offset), np.empty_like(offset)
        for which, law in self._laws:
            value, first[which], second[which] = law(offset[which])
            gap[which] -= value
        return gap / units, first, second

    def _evaluated(self, q: Coordinates, poses: LinkPoses) -> tuple[Array, list[Array]]:
        """Return residuals (rows, n), and the values of `_entries`, (..., n)."""
        residual = np.empty((self.rows, len(q)), q.values.dtype)
        blocks: list[Array] = []
        for group in self.groups:
            residual[group.rows], wrench = group.residual_and_wrench(poses)
            for block in group.blocks:
                moving = poses.unit_twists.take(block.columns, 0)
                jacobian = np.einsum("irmn,mcin->mrcn", wrench[:, :, block.which], moving)
                jacobian *= block.gains
                blocks.append(jacobian)
        if self.couplings:
            first = self.rows - len(self.couplings)
            gaps, rates, _ = self.coupled(q.values)
            residual[first:] = gaps - np.array(self.turn_offsets)[:, None]
            rows, columns = self._entries[-1]
            left, right = self._weights[:, rows - first, columns, None]
            units = self.units[columns, None] / self._zeros_and_units[2, rows - first]
            blocks.append((left - right * rates[rows - first]) * units)
        return residual, blocks

    def velocity_products(
        self, q: Coordinates, poses: LinkPoses, rates: Array, twist: Array, velocity_product: Array
    ) -> Array:
        """Return the velocity-product terms of the residuals for coordinate rates (count, n), (rows, n)."""
        out = np.empty((self.rows, len(q)), twist.dtype)
        for group in self.groups:
            out[group.rows] = group.velocity_products(poses, twist, velocity_product)
        if self.couplings:
            squared_rates = (self._weights[1] @ rates) ** 2 / self._zeros_and_units[2]
            out[-len(self.couplings) :] = -self.coupled(q.values)[2] * squared_rates
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
            offsets += (directions[:, columns] @ axial(relative)).T
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
            point_a, frame_a, point_b, frame_b = branch.ends if sides is None else sides[joint.name]
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
        """Return the whole revolutions between the sides of each coupling, (n,) in [rad]; 0 of a length."""
        return [
            REVOLUTION * np.round(gap / REVOLUTION) * row.has_revolutions
            for row, gap in zip(self.couplings, self.coupled(q.values)[0], strict=True)
        ]


# what solves the loop equations about a configuration
TreeSolver: TypeAlias = LoopSolver[TreeLoops, Coordinates]


def tree_loops(
    mechanism: Mechanism,
    poses: Mapping[str, Pose] | None = None,
    guess_coordinates: Mapping[str, float] | None = None,
) -> tuple[TreeLoops, Coordinates]:
    """Return the loop equations of a mechanism and the coordinates of its poses.

    Args:
        mechanism: the mechanism.
        poses: one pose or n poses of every moving link, closed or nearly so; default those of the guess.
        guess_coordinates: coordinate -> value, for coordinates that poses do not determine: whole revolutions
            of angles, and exact values of drivers and locked coordinates; default those of the description.
    """
    poses = guessed_poses(mechanism) if poses is None else poses
    values = initial_coordinates(mechanism) if guess_coordinates is None else guess_coordinates
    tree = spanning_tree(mechanism)
    driven = tuple(tree.index_of[name] for name in (*mechanism.drivers, *mechanism.locked))
    loops = TreeLoops(tree, cuts_of(tree), (), driven)
    q = loops.with_multi_turn(loops.read(poses), values)
    offsets = tuple(float(offset[0]) for offset in loops.revolutions_between(q))
    return replace(loops, turn_offsets=offsets), q


def with_sides(loops: TreeLoops, sides: Mapping[str, Ends]) -> TreeLoops:
    """Return loops in which the sides of some joints vary by instant: points (3, n) and frames (3, 3, n)."""
    branches = (
        replace(branch, ends=sides.get(branch.joint.name, branch.ends)) for branch in loops.tree.branches
    )
    cuts = (replace(cut, ends=sides.get(cut.joint.name, cut.ends)) for cut in loops.cuts)
    tree = replace(loops.tree, branches=tuple(branches))
    return TreeLoops(tree, tuple(cuts), loops.turn_offsets, loops.driven)


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
