"""The equations that close the loops of a spanning tree, in its coordinates.

A cut joint asks that side b's point and directions, as side a's frame sees them, are where the kind of
the joint wants them. Instants come last in every array.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure.spanning_tree import SpanningTree
from mechsim.analytic.closure.tree_layout import Some, in_a_row
from mechsim.analytic.closure.tree_motion import Placed, carried_frame, carried_point, cross, on_ground
from mechsim.maths.arrays import Array
from mechsim.model.joint_kinds import COLUMN, KINDS
from mechsim.model.joints import Joint
from mechsim.model.links import GROUND


@dataclass(frozen=True)
class Cut:
    """A joint that closes a loop.

    Attributes:
        joint: of the mechanism.
        sides: index of the links of its sides a and b; -1 is the ground.
        columns: coordinates of which only one side feels each.
        felt: by how much side b feels one unit of each, in [m] or [rad]; negative where side a does.
        size: of the mechanism, in [m].
    """

    joint: Joint
    sides: tuple[int, int]
    columns: NDArray[np.intp]
    felt: Array
    size: float

    @cached_property
    def span(self) -> Some:
        """The columns, as a slice where they lie in a row."""
        return in_a_row(self.columns)

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
        wanted = np.array([0.0] * lengths + [pair[2] for pair in self.directions])[:, None]
        return np.array([*self.lengths, *i], dtype=np.intp), j, units, wanted

    @cached_property
    def rows(self) -> int:
        """How many equations it is."""
        return len(self.lengths) + len(self.directions)

    @cached_property
    def ends(self) -> list[tuple[int, Array, Array]]:
        """Of sides a and b the link, the point and the joint frame, both in the link's."""
        ends = zip(self.sides, (self.joint.a, self.joint.b), strict=True)
        return [(link, np.array(end.point), end.frame) for link, end in ends]

    def frames(self, here: Placed) -> tuple[Array, Array, Array, Array]:
        """Return points (3, n) and joint frames (3, 3, n) of sides a and b."""
        found: list[Array] = []
        for link, point, frame in self.ends:
            if link < 0:
                found += on_ground(frame, point)[::-1]
            else:
                turn = here.rotation[link]
                found += [here.position[link] + carried_point(point, turn), carried_frame(frame, turn)]
        return found[0], found[1], found[2], found[3]

    def residual_and_slope(self, here: Placed) -> tuple[Array, Array]:
        """Return residuals (m, n), lengths in units of the size, and slopes by units (m, columns, n)."""
        point_a, frame_a, point_b, frame_b = self.frames(here)
        columns_a, columns_b, units, wanted = self.products
        screws, k = here.screws[self.span], len(self.lengths)
        seen = frame_a.take(columns_a, 1) * units
        held = np.empty((3, self.rows, screws.shape[2]), screws.dtype)
        held[:, :k] = point_b[:, None]
        held[:, k:] = frame_b.take(columns_b, 1)
        # forces along what is measured: their power is its rate
        wrench = np.zeros((6, *held.shape[1:]), screws.dtype)
        wrench[:3, :k] = seen[:, :k]
        wrench[3:] = cross(held, seen)
        slope = np.einsum("irn,cin->rcn", wrench, screws)
        slope *= self.felt[:, None]
        held[:, :k] -= point_a[:, None]
        return np.einsum("irn,irn->rn", seen, held) - wanted, slope

    def bias(self, here: Placed, twist: Array, drift: Array) -> Array:
        """Return the second rate of the residuals, (m, n), at the links' twists and drifts (links, 6, n)."""
        _, frame_a, point_b, frame_b = self.frames(here)
        still = np.zeros(twist.shape[1:])
        (ta, tb), (da, db) = ([still if i < 0 else of[i] for i in self.sides] for of in (twist, drift))
        wa, wb = ta[3:], tb[3:]
        velocity = [t[:3] + cross(t[3:], point_b) for t in (ta, tb)]
        acceleration = [
            d[:3] + cross(d[3:], point_b) + cross(w, v)
            for d, w, v in zip((da, db), (wa, wb), velocity, strict=True)
        ]
        # as seen from side a
        seen = acceleration[1] - acceleration[0] - 2.0 * cross(wa, velocity[1] - velocity[0])
        out = np.empty((self.rows, twist.shape[2]), twist.dtype)
        k = 0
        for i in self.lengths:
            out[k] = (frame_a[:, i] * seen).sum(0) / self.size
            k += 1
        for i, j, _ in self.directions:
            u, v = frame_a[:, i], frame_b[:, j]
            across, changing = cross(v, u), cross(cross(wb, v), u) + cross(v, cross(wa, u))
            out[k] = (across * (db[3:] - da[3:])).sum(0) + (changing * (wb - wa)).sum(0)
            k += 1
        return out


def cuts_of(tree: SpanningTree) -> tuple[Cut, ...]:
    """Return the joints that close the loops of a tree."""
    found: list[Cut] = []
    nothing = np.zeros(tree.count)
    for joint in tree.cuts:
        sides = tuple(-1 if end.link == GROUND else tree.index[end.link] for end in (joint.a, joint.b))
        feels = [nothing if i < 0 else tree.carried[i] for i in sides]
        sense = feels[1] - feels[0]
        columns = np.flatnonzero(sense)
        felt = (sense * tree.units)[columns]
        found.append(Cut(joint, (sides[0], sides[1]), columns, felt, tree.size))
    return tuple(found)
