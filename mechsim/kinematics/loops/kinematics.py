"""Link poses of a spanning tree at given coordinates, and the unit twist of each coordinate.

Instants are the last axis of every array, so that each component is contiguous in memory.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.kinematics.loops.tree import JointGroup, SpanningTree
from mechsim.kinematics.vector_method.vectors import array_cross as cross
from mechsim.mechanism.links import Pose
from mechsim.numerics.arrays import Array


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

    def __iter__(self) -> Iterator["Coordinates"]:
        """Yield the coordinates at each instant."""
        return (self.select(np.array([i])) for i in range(len(self)))

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

    def by_link(self, links: Mapping[str, int]) -> dict[str, Pose]:
        """Return the n poses of links, given by their indices."""
        return {
            name: Pose(self.position[i].T, self.rotation[i].transpose(2, 0, 1)) for name, i in links.items()
        }


def link_poses(tree: SpanningTree, q: Coordinates) -> LinkPoses:
    """Return the link poses at coordinates."""
    n, dtype, links = len(q), q.values.dtype, len(tree.branches)
    position, rotation = np.empty((links, 3, n), dtype), np.empty((links, 3, 3, n), dtype)
    # unit twists (count, 6, n) of rotations about axes through centres, (3, count, n), and slides
    unit_twists, centres = np.empty((6, tree.count, n), dtype), np.empty((3, tree.count, n), dtype)
    axes, slides = unit_twists[3:], tree.slides
    terms = np.empty((tree.count, 3, n), dtype)
    terms[:, 0], terms[:, 1], terms[:, 2] = 1.0, np.cos(q.values), np.sin(q.values)
    for group in tree.groups:
        relative = _relative_rotations(group, terms, q.turns)
        if group.parents is None:
            origin, on_parent, own = 0.0, _wide(group.on_parent.swapaxes(1, 2), 3), relative
        else:
            carrier = rotation[group.parents]
            origin, on_parent = position[group.parents], _carried(group.on_parent, carrier)
            own = matrix_product(carrier, relative)
        on_child = _carried(group.on_child, own)
        arm = on_parent[:, :, 0]
        # a link's displacement from its parent first: rods of equal length then cancel exactly
        displacement = arm - on_child[:, :, 0]
        for i, (k, (of_child, j)) in enumerate(zip(group.columns, group.axes, strict=True)):
            direction = (on_child if of_child else on_parent)[:, :, j]
            axes[:, k] = direction.swapaxes(0, 1)
            # axes of rotations pass through side b's point
            centres[:, k] = (origin + arm).swapaxes(0, 1)
            if i < len(group.kind.slides):
                slid = direction * q.values[k][:, None]
                displacement = displacement + slid
                arm = arm + slid if group.forward else arm
        rotation[group.children] = own
        position[group.children] = origin + displacement
    unit_twists[:3] = cross(centres, axes)
    if slides.any():
        unit_twists[:3, slides], axes[:, slides] = axes[:, slides], 0.0
    return LinkPoses(position, rotation, unit_twists.transpose(1, 0, 2))


def _relative_rotations(group: JointGroup, terms: Array, turns: Array) -> Array:
    """Return the rotations of links relative to their parents, (m, 3, 3, n)."""
    rotations = [_combined(factor, terms[k]) for k, factor in group.rotations]
    if rotations:
        return rotations[0] if len(rotations) == 1 else matrix_product(*rotations)
    frame, child_frame = _wide(group.sides.parent_frame, 3), _wide(group.sides.child_frame.swapaxes(1, 2), 3)
    if group.turns is not None:
        ball_rotation = turns[group.turns]
        frame = matrix_product(frame, ball_rotation if group.forward else ball_rotation.swapaxes(1, 2))
    return matrix_product(frame, child_frame)


def _combined(factors: Array, terms: Array) -> Array:
    """Return rotations (m, 3, 3, n) from factors (m, 9, 3[, n]) of 1, cosine and sine, (m, 3, n)."""
    rotation = factors @ terms if factors.ndim == 3 else np.einsum("maen,men->man", factors, terms)
    return rotation.reshape(len(factors), 3, 3, -1)


def _wide(constant: Array, axes: int) -> Array:
    """Return vectors or matrices with a last axis for the instants, of length 1 if they have none."""
    return constant[..., None] if constant.ndim == axes else constant


def on_ground(frame: Array, point: Array) -> tuple[Array, Array]:
    """Return frames and points of the ground, as (m, 3, 3, n) and (m, 3, n) or with 1 for n."""
    return _wide(frame, 3), _wide(point, 2)


def carried_frame(frame: Array, rotation: Array) -> Array:
    """Return frames (m, 3, 3) of links, or (m, 3, 3, n) of many designs, rotated with them, (m, 3, 3, n)."""
    if frame.ndim == 3:
        return frame.swapaxes(1, 2)[:, None] @ rotation
    return matrix_product(rotation, frame)


def _carried(vectors: Array, rotation: Array) -> Array:
    """Return vectors (m, k, 3) of links, or (m, k, 3, n) of many designs, rotated with them, (m, 3, k, n)."""
    if vectors.ndim == 3:
        return vectors[:, None] @ rotation
    return np.einsum("mkjn,mijn->mikn", vectors, rotation)


def carried_point(point: Array, rotation: Array) -> Array:
    """Return points (m, 3) of links, or (m, 3, n) of many designs, rotated with them, (m, 3, n)."""
    if point.ndim == 2:
        return (point[:, None, None] @ rotation)[:, :, 0]
    return np.einsum("mkn,mikn->min", point, rotation)


def twists(tree: SpanningTree, poses: LinkPoses, rates: Array) -> Array:
    """Return each link's twist at coordinate rates (count, n): (links, 6, n), at the ground's origin."""
    return _summed(tree, poses.unit_twists * rates[:, None])


def velocity_products(tree: SpanningTree, poses: LinkPoses, twist: Array, rates: Array) -> Array:
    """Return the links' velocity-product terms at coordinate rates, (links, 6, n), as `twists`."""
    unit_twists, moving = poses.unit_twists.transpose(1, 0, 2), twist.transpose(1, 0, 2)
    derivative = np.empty_like(unit_twists)
    zero = np.zeros((6, 1, twist.shape[2]))
    for group in tree.groups:
        parent, child = zero if group.parents is None else moving[:, group.parents], moving[:, group.children]
        a, b = (parent, child) if group.forward else (child, parent)
        kind = group.kind
        for i, (k, axis) in enumerate(zip(group.columns, (*kind.slides, *kind.turns), strict=True)):
            # axes fixed on side a: slides, axes of a ball, the first of two crossed axes; else on b
            in_a = i < len(kind.slides) or kind.ball or (kind.crossed and axis == "a")
            w, s = a if in_a else b, unit_twists[:, k]
            derivative[3:, k] = changed = cross(w[3:], s[3:])
            if i >= len(kind.slides) and kind.slides and kind.ball:
                # the axis passes through b's point, but moves with a
                centre = _centres(group, poses)
                derivative[:3, k] = cross(b[:3] + cross(b[3:], centre), s[3:]) + cross(centre, changed)
            else:
                derivative[:3, k] = cross(w[3:], s[:3]) + cross(w[:3], s[3:])
    return _summed(tree, (derivative * rates).transpose(1, 0, 2))


def _centres(group: JointGroup, poses: LinkPoses) -> Array:
    """Return the positions of side b's points of tree joints, (3, m, n) or (3, m, 1)."""
    links = group.children if group.forward else group.parents
    point = group.sides.child_point if group.forward else group.sides.parent_point
    if links is None:
        return _wide(point, 2).swapaxes(0, 1)
    return (poses.position[links] + carried_point(point, poses.rotation[links])).swapaxes(0, 1)


def _summed(tree: SpanningTree, terms: Array) -> Array:
    """Return for each link the sum over the coordinates that move it, (links, 6, n)."""
    total = np.empty((len(tree.branches), *terms.shape[1:]), terms.dtype)
    for group in tree.groups:
        value = terms[group.columns[0]] if group.columns else 0.0
        for k in group.columns[1:]:
            value = value + terms[k]
        total[group.children] = value if group.parents is None else total[group.parents] + value
    return total


def axial(matrix: Array) -> Array:
    """Return the vectors (3, n) of the skew-symmetric components of matrices (3, 3, n)."""
    return 0.5 * (matrix - matrix.transpose(1, 0, 2))[[2, 0, 1], [1, 2, 0]]


def matrix_product(a: Array, b: Array) -> Array:
    """Return matrix products of (3, 3, n), or (m, 3, 3, n)."""
    return np.einsum("ijn,jkn->ikn" if a.ndim == 3 else "mijn,mjkn->mikn", a, b)
