"""The loops of a mechanism in coordinates of its tree: how far they stand open, and closing them.

Unknown are the coordinates that no driver prescribes. Where the rows repeat each other, as in a flat
linkage, as many are kept as are independent; where they leave a link's spin open, a gauge keeps it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.coupled_rows import CoupledRow, coupled_rows
from mechsim.analytic.loops.cut_rows import Cut, cuts_of
from mechsim.analytic.loops.spanning_tree import SpanningTree, spanning_tree
from mechsim.analytic.loops.tree_motion import Coordinates, LinkPoses, cross, link_poses, product
from mechsim.model.joint_kinds import coordinates
from mechsim.model.link_poses import with_stand_ins
from mechsim.model.links import GROUND, IDENTITY, Pose
from mechsim.model.mechanism import Mechanism
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array


@dataclass(frozen=True)
class TreeLoops:
    """The loop equations of a mechanism in the coordinates of a spanning tree.

    Attributes:
        tree: the tree.
        cuts: the joints that close its loops.
        turn_offsets: of each coupling, the whole turns between its sides as put together, in [rad].
        driven: indices of the coordinates that are prescribed.
    """

    tree: SpanningTree
    cuts: tuple[Cut, ...]
    turn_offsets: tuple[float, ...]
    driven: tuple[int, ...]

    @cached_property
    def unknown(self) -> NDArray[np.intp]:
        """Indices of the coordinates that the loops determine."""
        return np.delete(np.arange(self.tree.count), self.driven)

    @cached_property
    def units(self) -> Array:
        """Of the tree: what one unit of each coordinate is in the equations."""
        return self.tree.units

    @cached_property
    def couplings(self) -> tuple[CoupledRow, ...]:
        """The rows of the couplings."""
        return coupled_rows(self.tree)

    @cached_property
    def rows(self) -> int:
        """How many equations there are."""
        return sum(cut.rows for cut in self.cuts) + len(self.turn_offsets)

    def linearise(self, q: Coordinates) -> tuple[Array, Array, LinkPoses]:
        """Return residuals (rows, n), slopes by coordinates in units (rows, count, n), and the links."""
        poses = link_poses(self.tree, q)
        n = len(q)
        dtype = q.values.dtype
        residual = np.empty((self.rows, n), dtype)
        jacobian = np.zeros((self.rows, self.tree.count, n), dtype)
        k = 0
        for cut in self.cuts:
            block = slice(k, k + cut.rows)
            residual[block], jacobian[block, cut.span] = cut.residual_and_jacobian(poses)
            k += cut.rows
        for coupling, offset in zip(self.couplings, self.turn_offsets, strict=True):
            violation, derivative, _ = coupling.evaluate(q.values)
            jacobian[k] = derivative * self.units[:, None]
            residual[k] = violation - offset / coupling.unit
            k += 1
        return residual, jacobian, poses

    def velocity_products(
        self, q: Coordinates, poses: LinkPoses, rates: Array, twist: Array, velocity_product: Array
    ) -> Array:
        """Return the residuals' second rate at coordinate rates (count, n) that do not change, (rows, n)."""
        blocks = [cut.velocity_products(poses, twist, velocity_product) for cut in self.cuts]
        coupled = [coupling.velocity_products(q.values, rates)[None] for coupling in self.couplings]
        return np.concatenate([np.empty((0, len(q))), *blocks, *coupled])

    def displaced(self, q: Coordinates, step: Array) -> Coordinates:
        """Return coordinates moved by a step (count, n) in their units."""
        values, rotations = q.values + step * self.units[:, None], q.turns
        if len(rotations):
            values[self.tree.ball_indices] = 0.0
            rotations = np.stack(
                [
                    _turned(rotation, step[ball.first_angle : ball.first_angle + 3])
                    for rotation, ball in zip(rotations, self.tree.balls, strict=True)
                ]
            )
        return Coordinates(values, rotations)

    def read(self, poses: Mapping[str, Pose], angles: Mapping[str, float]) -> Coordinates:
        """Return the coordinates of one pose of every moving link; given angles as they are counted."""
        everywhere = {GROUND: IDENTITY, **with_stand_ins(self.tree.mechanism, poses)}
        values, rotations = np.zeros((self.tree.count, 1)), np.empty((len(self.tree.balls), 3, 3, 1))
        ball = 0
        for branch in self.tree.branches:
            joint = branch.joint
            a, b = ((everywhere[end.link], end) for end in (joint.a, joint.b))
            (point_a, rotation_a), (point_b, rotation_b) = (
                (_first(pose.point(end.point), 1), _first(pose.rotation, 2) @ end.frame)
                for pose, end in (a, b)
            )
            if branch.kind.ball:
                rotations[ball, ..., 0] = rotation_a.T @ rotation_b
                ball += 1
            joint_values = coordinates(
                branch.kind, point_b - point_a, rotation_a, rotation_b, joint.cross_angle
            )
            values[branch.first : branch.first + len(joint_values), 0] = joint_values
            for i, name in enumerate(joint.coordinates):
                if name in angles:
                    values[branch.first + i, 0] = angles[name]
        return Coordinates(values, rotations)


def tree_loops(
    mechanism: Mechanism, poses: Mapping[str, Pose], counted: Mapping[str, float]
) -> tuple[TreeLoops, Coordinates]:
    """Return the loops of a mechanism and the coordinates of its poses.

    Args:
        mechanism: the mechanism.
        poses: of every moving link, closed or nearly so.
        counted: coordinate -> value, of those that the poses do not tell exactly: of angles the turns, of
            drivers and holds where they stand.
    """
    tree = spanning_tree(mechanism)
    prescribed = {*mechanism.drivers, *mechanism.locked}
    driven = tuple(tree.index_of[name] for name in (*mechanism.drivers, *mechanism.locked))
    loops = TreeLoops(tree, cuts_of(tree), (), driven)
    q = loops.read(poses, {})
    for name, value in counted.items():
        index = tree.index_of.get(name)
        if index is None:
            continue
        revolutions = (
            0.0 if tree.slides[index] else TURN * float(np.round((value - q.values[index, 0]) / TURN))
        )
        q.values[index, 0] = value if name in prescribed else q.values[index, 0] + revolutions
    turn_offsets = [
        TURN * float(np.round(row.evaluate(q.values)[0][0] * row.unit / TURN)) if row.turns else 0.0
        for row in loops.couplings
    ]
    return replace(loops, turn_offsets=tuple(turn_offsets)), q


def _first(value: Array, axes: int) -> Array:
    return value[0] if value.ndim > axes else value


def _turned(rotation: Array, vector: Array) -> Array:
    """Return exp(vector) @ turn, (3, 3, n), made orthogonal again to rounding."""
    angle = np.sqrt((vector**2).sum(0))
    small = angle < 1e-8
    safe = np.where(small, 1.0, angle)
    a = np.where(small, 1.0, np.sin(safe) / safe)
    b = np.where(small, 0.5, 2.0 * (np.sin(0.5 * safe) / safe) ** 2)
    first_order = cross(vector[:, None], rotation)
    rotated = rotation + a * first_order + b * cross(vector[:, None], first_order)
    return orthogonal(rotated)


def orthogonal(rotation: Array) -> Array:
    """Return nearly orthogonal matrices (3, 3, n) a Newton step nearer to the nearest rotations."""
    return 1.5 * rotation - 0.5 * product(rotation, product(rotation.transpose(1, 0, 2), rotation))
