"""Link poses of a spanning tree at given coordinates, and the unit twist of each coordinate.

Instants are the last axis of every array, so that each component is contiguous in memory.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.kinematics.loops.tree import SpanningTree, TreeJoint
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
    axes, centres = np.empty((2, 3, tree.count, n), dtype)
    for branch, relative in zip(tree.branches, _relative_rotations(tree, q), strict=True):
        sides, i, parent = tree.constants[branch.child], branch.child, branch.parent
        if parent < 0:
            origin, arm, rotation[i] = 0.0, _wide(sides.parent_point, 1), relative
        else:
            origin, arm = position[parent], carried_point(sides.parent_point, rotation[parent])
            rotation[i] = matrix_product(rotation[parent], relative)
        slid = np.zeros((3, 1), dtype)
        for k, (link, axis) in enumerate(tree.axes[i], branch.first):
            axes[:, k] = _wide(axis, 1) if link < 0 else carried_point(axis, rotation[link])
            # axes of rotations pass through side b's point
            centres[:, k] = origin + (arm + slid if branch.forward else arm)
            if k < branch.first_angle:
                slid = slid + axes[:, k] * q.values[k]
        # a link's displacement from its parent first: rods of equal length then cancel exactly
        position[i] = origin + (arm - carried_point(sides.child_point, rotation[i]) + slid)
    # unit twists (count, 6, n) of rotations about axes through centres, (3, count, n), and slides
    unit_twists = np.empty((tree.count, 6, axes.shape[2]), axes.dtype).transpose(1, 0, 2)
    unit_twists[:3], unit_twists[3:] = cross(centres, axes), axes
    if tree.slides.any():
        unit_twists[:3, tree.slides], unit_twists[3:, tree.slides] = axes[:, tree.slides], 0.0
    return LinkPoses(position, rotation, unit_twists.transpose(1, 0, 2))


def _relative_rotations(tree: SpanningTree, q: Coordinates) -> Iterator[Array]:
    """Yield the rotation of each link relative to its parent, (3, 3, n), in the order of the tree joints."""
    terms = np.empty((tree.count, 3, len(q)), q.values.dtype)
    terms[:, 0], terms[:, 1], terms[:, 2] = 1.0, np.cos(q.values), np.sin(q.values)
    turns = iter(q.turns)
    for branch in tree.branches:
        factors = zip(tree.rotations[branch.child], branch.angles, strict=False)
        rotations = [_combined(factor, terms[k]) for factor, k in factors]
        if branch.angles:
            yield rotations[0] if len(rotations) == 1 else matrix_product(*rotations)
            continue
        sides = tree.constants[branch.child]
        frame, child_frame = _wide(sides.parent_frame, 2), _wide(sides.child_frame.swapaxes(0, 1), 2)
        if branch.kind.ball:
            ball_rotation = next(turns)
            frame = matrix_product(frame, ball_rotation if branch.forward else ball_rotation.swapaxes(0, 1))
        yield matrix_product(frame, child_frame)


def _combined(factors: Array, terms: Array) -> Array:
    """Return a rotation (3, 3, n) from factors (9, 3), or (9, 3, n), of 1, cosine and sine, (3, n)."""
    rotation = factors @ terms if factors.ndim == 2 else np.einsum("aen,en->an", factors, terms)
    return rotation.reshape(3, 3, -1)


def _wide(constant: Array, axes: int) -> Array:
    """Return a vector or matrix with a last axis of length 1 for the instants; unchanged if it has one."""
    return constant[..., None] if constant.ndim == axes else constant


def on_ground(frame: Array, point: Array) -> tuple[Array, Array]:
    """Return a frame and a point of the ground, as (3, 3, n) and (3, n) or with 1 for n."""
    return (frame[..., None], point[:, None]) if frame.ndim == 2 else (frame, point)


def carried_frame(frame: Array, rotation: Array) -> Array:
    """Return a frame (3, 3) of a link, or (3, 3, n) of many designs, rotated with the link, (3, 3, n)."""
    return frame.T @ rotation if frame.ndim == 2 else matrix_product(rotation, frame)


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


def matrix_product(a: Array, b: Array) -> Array:
    """Return matrix products of (3, 3, n)."""
    return np.einsum("ijn,jkn->ikn", a, b)
