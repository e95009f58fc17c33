"""Link poses of a spanning tree at given coordinates, and the unit twist of each coordinate.

Instants are the last axis of every array, so that each component is contiguous in memory.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.tree import SpanningTree, TreeJoint
from mechsim.analytic.vector_method.vectors import array_cross as cross
from mechsim.numerics.arrays import Array

EYE = np.eye(3)[..., None]


@dataclass(frozen=True, slots=True)
class Coordinates:
    """Coordinates of a tree at n instants.

    Attributes:
        values: (count, n) in [m] and [rad]; those of a spherical joint are unused. Complex for complex
            dimensions.
        turns: rotation of each spherical joint, side b's frame in side a's, (balls, 3, 3, n).
    """

    values: Array
    turns: Array

    def __len__(self) -> int:
        return self.values.shape[1]

    def select(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> "Coordinates":
        """Return the coordinates at some of the instants."""
        return Coordinates(self.values[:, which], self.turns[..., which])

    def repeated(self, times: int) -> "Coordinates":
        """Return the coordinates repeated as a whole."""
        return Coordinates(np.tile(self.values, times), np.tile(self.turns, times))


@dataclass(frozen=True, slots=True)
class LinkPoses:
    """The links of a tree at n instants.

    Attributes:
        position: position of each link's origin, (links, 3, n) in [m].
        rotation: rotation of each link, (links, 3, 3, n).
        unit_twists: twist for a unit rate of each coordinate: velocity at the ground's origin and angular
            velocity, (count, 6, n).
    """

    position: Array
    rotation: Array
    unit_twists: Array


def link_poses(tree: SpanningTree, q: Coordinates) -> LinkPoses:
    """Return the link poses at coordinates."""
    layout, n, dtype = tree.layout, len(q), q.values.dtype
    # the ground is last, at index -1
    rotation = np.empty((len(tree.branches) + 1, 3, 3, n), dtype)
    _rotate(tree, q, rotation)
    rotation[-1] = EYE
    for child, parent in layout.tiers:
        rotation[child] = np.einsum("lijn,ljkn->likn", rotation[parent], rotation[child])
    carried = _carried(layout.vectors, rotation[layout.holders])
    fixed = carried.reshape(3, carried.shape[1] * carried.shape[2], n)
    axes = spins = fixed.take(layout.axes, 1)
    position = np.zeros((3, len(rotation), n), dtype)
    np.subtract(
        fixed.take(layout.parent_points, 1), carried[:, : len(tree.branches), 0], out=position[:, :-1]
    )
    if len(layout.slides):
        along = axes[:, layout.slides]
        for link, displacement in zip(
            layout.slid, (along * q.values[layout.slides]).swapaxes(0, 1), strict=True
        ):
            position[:, link] += displacement
        spins = axes.copy()
        spins[:, layout.slides] = 0.0
    for child, parent in layout.tiers:
        position[:, child] += position[:, parent]
    unit_twists = np.empty((tree.count, 6, n), dtype).transpose(1, 0, 2)
    unit_twists[3:] = spins
    unit_twists[:3] = cross(position.take(layout.centred, 1) + fixed.take(layout.centres, 1), spins)
    if len(layout.slides):
        unit_twists[:3, layout.slides] = axes[:, layout.slides]
    return LinkPoses(position[:, :-1].transpose(1, 0, 2), rotation[:-1], unit_twists.transpose(1, 0, 2))


def _carried(vectors: Array, rotation: Array) -> Array:
    """Return vectors, (rows, m, 3) or (rows, m, 3, n), rotated with their links: (3, rows, m, n)."""
    if vectors.ndim == 3:
        return vectors @ rotation.transpose(1, 0, 2, 3)
    return np.einsum("lmkn,likn->ilmn", vectors, rotation)


def _rotate(tree: SpanningTree, q: Coordinates, out: Array) -> None:
    """Store the rotation of each link relative to its parent, (links + 1, 3, 3, n)."""
    layout = tree.layout
    angle = q.values[layout.angles]
    terms = np.empty((len(angle), 3, len(q)), angle.dtype)
    terms[:, 0] = 1.0
    np.cos(angle, out=terms[:, 1])
    np.sin(angle, out=terms[:, 2])
    rotations = (
        layout.rotations @ terms
        if layout.rotations.ndim == 3
        else np.einsum("haen,hen->han", layout.rotations, terms)
    ).reshape(len(angle), 3, 3, len(q))
    out[layout.single[0]] = rotations[layout.single[1]]
    link, first, second = layout.double
    if len(link):
        out[link] = np.einsum("lijn,ljkn->likn", rotations[first], rotations[second])
    for branch, ball in layout.stiff:
        fixed = tree.constants[branch.child]
        frame, child_frame = (
            _wide(matrix) for matrix in (fixed.parent_frame, fixed.child_frame.swapaxes(0, 1))
        )
        if ball is not None:
            rotation = q.turns[ball]
            frame = product(frame, rotation if branch.forward else rotation.swapaxes(0, 1))
        out[branch.child] = product(frame, child_frame)


def _wide(matrix: Array) -> Array:
    """Return a matrix (3, 3) as (3, 3, 1); a matrix (3, 3, n) unchanged."""
    return matrix[..., None] if matrix.ndim == 2 else matrix


def on_ground(frame: Array, point: Array) -> tuple[Array, Array]:
    """Return a frame and a point of the ground, as (3, 3, n) and (3, n) or with 1 for n."""
    return (frame[..., None], point[:, None]) if frame.ndim == 2 else (frame, point)


def carried_frame(frame: Array, rotation: Array) -> Array:
    """Return a frame (3, 3) of a link, or (3, 3, n) of many designs, rotated with the link, (3, 3, n)."""
    return frame.T @ rotation if frame.ndim == 2 else product(rotation, frame)


def carried_point(point: Array, rotation: Array) -> Array:
    """Return a point (3,) of a link, or (3, n) of many designs, rotated with the link, (3, n)."""
    return point @ rotation if point.ndim == 1 else np.einsum("kn,ikn->in", point, rotation)


def twists(tree: SpanningTree, poses: LinkPoses, rates: Array) -> Array:
    """Return each link's twist at coordinate rates (count, n): (links, 6, n), at the ground's origin."""
    return _summed(tree, poses.unit_twists * rates[:, None])


def velocity_products(tree: SpanningTree, poses: LinkPoses, twist: Array, rates: Array) -> Array:
    """Return the links' velocity-product terms at coordinate rates, (links, 6, n), as `twists`."""
    derivative = np.empty_like(poses.unit_twists)
    zero = np.zeros(twist.shape[1:])
    for branch in tree.branches:
        parent, child = zero if branch.parent < 0 else twist[branch.parent], twist[branch.child]
        a, b = (parent, child) if branch.forward else (child, parent)
        kind, k = branch.kind, branch.first
        for axis in (*kind.slides, *kind.turns):
            # axes fixed on side a: slides, axes of a ball, the first of two crossed axes; else on b
            in_a = k < branch.first_angle or kind.ball or (kind.crossed and axis == "a")
            w, s = a if in_a else b, poses.unit_twists[k]
            derivative[k, 3:] = cross(w[3:], s[3:])
            if k >= branch.first_angle and kind.slides and kind.ball:
                # the axis passes through b's point, but moves with a
                centre = _centre(tree, branch, poses)
                derivative[k, :3] = cross(b[:3] + cross(b[3:], centre), s[3:]) + cross(
                    centre, derivative[k, 3:]
                )
            else:
                derivative[k, :3] = cross(w[3:], s[:3]) + cross(w[:3], s[3:])
            k += 1
    derivative *= rates[:, None]
    return _summed(tree, derivative)


def _centre(tree: SpanningTree, branch: TreeJoint, poses: LinkPoses) -> Array:
    """Return the position of side b's point of a tree joint, (3, n) or (3, 1)."""
    fixed = tree.constants[branch.child]
    link, point = (branch.child, fixed.child_point) if branch.forward else (branch.parent, fixed.parent_point)
    if link < 0:
        return point[:, None] if point.ndim == 1 else point
    return poses.position[link] + carried_point(point, poses.rotation[link])


def _summed(tree: SpanningTree, terms: Array) -> Array:
    """Return for each link the sum over the coordinates that move it, (links, 6, n)."""
    total = np.empty((len(tree.branches), *terms.shape[1:]), terms.dtype)
    for branch in tree.branches:
        if not branch.kind.dof:
            total[branch.child] = 0.0 if branch.parent < 0 else total[branch.parent]
            continue
        value = terms[branch.first]
        for k in range(branch.first + 1, branch.first + branch.kind.dof):
            value = value + terms[k]
        total[branch.child] = value if branch.parent < 0 else total[branch.parent] + value
    return total


def product(a: Array, b: Array) -> Array:
    """Return matrix products of (3, 3, n)."""
    return np.einsum("ijn,jkn->ikn", a, b)
