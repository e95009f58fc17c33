"""The equations that close the loops of a spanning tree, in its coordinates.

A cut joint asks that side b's point and directions, as side a's frame sees them, are where the kind of
the joint wants them. Instants come last in every array.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.spanning_tree import SpanningTree
from mechsim.analytic.loops.tree_layout import Index, as_slice
from mechsim.analytic.loops.tree_motion import LinkPoses, carried_frame, carried_point, cross, on_ground
from mechsim.model.joint_kinds import COLUMN, KINDS
from mechsim.model.joints import Joint
from mechsim.model.links import GROUND
from mechsim.numerics.arrays import Array


@dataclass(frozen=True)
class Cut:
    """A joint that closes a loop.

    Attributes:
        joint: of the mechanism.
        sides: index of the links of its sides a and b; -1 is the ground.
        columns: coordinates of which only one side feels each.
        gains: by how much side b feels one unit of each, in [m] or [rad]; negative where side a does.
        size: of the mechanism, in [m].
    """

    joint: Joint
    sides: tuple[int, int]
    columns: NDArray[np.intp]
    gains: Array
    size: float

    @cached_property
    def span(self) -> Index:
        """The columns, as a slice where they lie in a row."""
        return as_slice(self.columns)

    @cached_property
    def lengths(self) -> list[int]:
        """Columns of side a's frame along which the points must lie on each other."""
        free = {COLUMN[axis] for axis in KINDS[self.joint.kind].slides}
        return [i for i in range(3) if i not in free]

    @cached_property
    def directions(self) -> list[tuple[int, int, float]]:
        """(i, j, c): column i of a's frame and column j of b's have the scalar product c."""
        kind = KINDS[self.joint.kind]
        if kind.crossed:
            return [(2, 2, np.cos(self.joint.cross_angle))]
        if not kind.aligned:
            return []
        return [(0, 2, 0.0), (1, 2, 0.0), *([] if kind.turns else [(0, 1, 0.0)])]

    @cached_property
    def products(self) -> tuple[NDArray[np.intp], NDArray[np.intp], Array, Array]:
        """What is multiplied: by row a column of a's frame, by direction one of b's; units, products wanted.

        The last two are (rows, 1).
        """
        i, j = (np.array([pair[k] for pair in self.directions], dtype=np.intp) for k in (0, 1))
        lengths = len(self.lengths)
        units = np.repeat([1.0 / self.size, 1.0], [lengths, len(i)])[:, None]
        targets = np.array([0.0] * lengths + [pair[2] for pair in self.directions])[:, None]
        return np.array([*self.lengths, *i], dtype=np.intp), j, units, targets

    @cached_property
    def rows(self) -> int:
        """How many equations it is."""
        return len(self.lengths) + len(self.directions)

    @cached_property
    def ends(self) -> list[tuple[int, Array, Array]]:
        """Of sides a and b the link, the point and the joint frame, both in the link's."""
        ends = zip(self.sides, (self.joint.a, self.joint.b), strict=True)
        return [(link, np.array(end.point), end.frame) for link, end in ends]

    def frames(self, poses: LinkPoses) -> tuple[Array, Array, Array, Array]:
        """Return points (3, n) and joint frames (3, 3, n) of sides a and b."""
        sides: list[Array] = []
        for link, point, frame in self.ends:
            if link < 0:
                sides += on_ground(frame, point)[::-1]
            else:
                rotation = poses.rotation[link]
                sides += [
                    poses.position[link] + carried_point(point, rotation),
                    carried_frame(frame, rotation),
                ]
        return sides[0], sides[1], sides[2], sides[3]

    def residual_and_jacobian(self, poses: LinkPoses) -> tuple[Array, Array]:
        """Return residuals (m, n), lengths in units of the size, and slopes by units (m, columns, n)."""
        point_a, frame_a, point_b, frame_b = self.frames(poses)
        columns_a, columns_b, units, targets = self.products
        unit_twists, k = poses.unit_twists[self.span], len(self.lengths)
        directions_a = frame_a.take(columns_a, 1) * units
        measured = np.empty((3, self.rows, unit_twists.shape[2]), unit_twists.dtype)
        measured[:, :k] = point_b[:, None]
        measured[:, k:] = frame_b.take(columns_b, 1)
        # forces along what is measured: their power is its rate
        wrench = np.zeros((6, *measured.shape[1:]), unit_twists.dtype)
        wrench[:3, :k] = directions_a[:, :k]
        wrench[3:] = cross(measured, directions_a)
        jacobian = np.einsum("irn,cin->rcn", wrench, unit_twists)
        jacobian *= self.gains[:, None]
        measured[:, :k] -= point_a[:, None]
        return np.einsum("irn,irn->rn", directions_a, measured) - targets, jacobian

    def velocity_products(self, poses: LinkPoses, twist: Array, velocity_product: Array) -> Array:
        """Return the second rate of the residuals, (m, n), at the links' twists and drifts (links, 6, n)."""
        _, frame_a, point_b, frame_b = self.frames(poses)
        zero = np.zeros(twist.shape[1:])
        (ta, tb), (da, db) = (
            [zero if i < 0 else values[i] for i in self.sides] for values in (twist, velocity_product)
        )
        wa, wb = ta[3:], tb[3:]
        velocity = [t[:3] + cross(t[3:], point_b) for t in (ta, tb)]
        acceleration = [
            d[:3] + cross(d[3:], point_b) + cross(w, v)
            for d, w, v in zip((da, db), (wa, wb), velocity, strict=True)
        ]
        # as seen from side a
        relative = acceleration[1] - acceleration[0] - 2.0 * cross(wa, velocity[1] - velocity[0])
        out = np.empty((self.rows, twist.shape[2]), twist.dtype)
        k = 0
        for i in self.lengths:
            out[k] = (frame_a[:, i] * relative).sum(0) / self.size
            k += 1
        for i, j, _ in self.directions:
            u, v = frame_a[:, i], frame_b[:, j]
            across, changing = cross(v, u), cross(cross(wb, v), u) + cross(v, cross(wa, u))
            out[k] = (across * (db[3:] - da[3:])).sum(0) + (changing * (wb - wa)).sum(0)
            k += 1
        return out


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
        cuts.append(Cut(joint, (sides[0], sides[1]), columns, gains, tree.size))
    return tuple(cuts)
