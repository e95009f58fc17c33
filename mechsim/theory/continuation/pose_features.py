"""Features that identify the pose of a mechanism regardless of passive motion, and the non-passive motion."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.spanning_tree import SpanningTree
from mechsim.analytic.loops.tree_loops import TreeLoops
from mechsim.analytic.loops.tree_motion import LinkPoses, cross, twists
from mechsim.errors import MobilityError
from mechsim.model.links import GROUND
from mechsim.numerics.arrays import Array

# component of a unit motion below which a coordinate or a point is at rest
REST = 1e-6


@dataclass(frozen=True, slots=True)
class PoseFeatures:
    """Points and directions of links that determine each link's pose up to passive rotation.

    A link without passive motion contributes its origin, divided by the characteristic length, and its axes,
    divided by sqrt 2, so that the norm of their rates is the norm of its twist. A link that can rotate
    passively contributes its points on the axis of that rotation.

    Attributes:
        tree: of the mechanism.
        links: index of the link of each feature, (k,).
        local: point or direction in the link's frame, (3, k).
        is_point: whether it is a point; otherwise a direction, (k,).
        weights: factor on each, (k,).
    """

    tree: SpanningTree
    links: NDArray[np.intp]
    local: Array
    is_point: NDArray[np.bool_]
    weights: Array

    def values(self, poses: LinkPoses) -> Array:
        """Return the features of n poses, (n, 3 k)."""
        rotated = np.einsum("kijn,jk->ikn", poses.rotation[self.links], self.local)
        features = rotated + np.where(
            self.is_point[:, None], poses.position[self.links].transpose(1, 0, 2), 0.0
        )
        return (features * self.weights[:, None]).reshape(-1, features.shape[2]).T

    def rates(self, poses: LinkPoses, rates: Array) -> Array:
        """Return the rates of the features, (n, 3 k), at coordinate rates (count, n) in SI."""
        twist = twists(self.tree, poses, rates)[self.links].transpose(1, 0, 2)
        rotated = np.einsum("kijn,jk->ikn", poses.rotation[self.links], self.local)
        features = rotated + np.where(
            self.is_point[:, None], poses.position[self.links].transpose(1, 0, 2), 0.0
        )
        derivatives = np.where(self.is_point[:, None], twist[:3], 0.0) + cross(twist[3:], features)
        return (derivatives * self.weights[:, None]).reshape(-1, derivatives.shape[2]).T


def pose_features(tree: SpanningTree, poses: LinkPoses, idle: Array) -> PoseFeatures:
    """Return the features of a mechanism whose passive motions at one pose are (count, idle) in SI."""
    mechanism, length = tree.mechanism, tree.mechanism.size
    spins = np.zeros(len(mechanism.links), dtype=np.bool_)
    if idle.shape[1]:
        twist = np.abs(twists(tree, poses, idle)).max(2)
        spins = np.maximum(twist[:, :3].max(1) / length, twist[:, 3:].max(1)) > REST
    rows: list[tuple[int, tuple[float, ...], bool, float]] = []
    for i, link in enumerate(mechanism.links):
        if not spins[i]:
            rows.append((i, (0.0, 0.0, 0.0), True, 1.0 / length))
            rows += [(i, tuple(axis), False, np.sqrt(0.5)) for axis in np.eye(3).tolist()]
            continue
        points = [end.point for end in mechanism.ends(link.name)]
        points += [point for name, point in mechanism.points.values() if name == link.name]
        rows += [(i, point, True, 1.0 / length) for point in dict.fromkeys(points)]
    links, local, is_point, weights = zip(*rows, strict=True)
    features = PoseFeatures(tree, np.array(links), np.array(local).T, np.array(is_point), np.array(weights))
    if not idle.shape[1]:
        return features
    at_rest = np.abs(features.rates(poses, idle)).max(0).reshape(3, -1).max(0) <= REST
    return PoseFeatures(
        tree,
        features.links[at_rest],
        features.local[:, at_rest],
        features.is_point[at_rest],
        features.weights[at_rest],
    )


def all_rates(loops: TreeLoops, directions: Array) -> Array:
    """Return rates of all coordinates in SI, (count, n), from scaled rates of the unknowns, (n, u)."""
    rates = np.zeros((loops.tree.count, len(directions)))
    rates[loops.unknown] = directions.T * loops.units[loops.unknown, None]
    return rates


def split_motion(loops: TreeLoops, poses: LinkPoses, free: Array) -> tuple[Array, Array]:
    """Split the null space into the motion of joint coordinates or tracked points and the passive motions.

    Args:
        loops: of the mechanism, its drivers free.
        poses: one pose.
        free: orthonormal null-space basis of the unknowns in their units, (dofs, unknowns).

    Returns:
        The motion, (unknowns,), and the passive ones, (dofs - 1, unknowns).

    Raises:
        MobilityError: where more than one direction moves any of them, or none does.
    """
    tree, mechanism = loops.tree, loops.tree.mechanism
    rates = all_rates(loops, free)
    addresses = list(tree.index_of.values())
    twist = twists(tree, poses, rates)
    observed = [rates[addresses] / loops.units[addresses, None]]
    for link, local in mechanism.points.values():
        if link != GROUND:
            i = tree.links[link]
            arm = poses.position[i] + np.einsum("ijn,j->in", poses.rotation[i], np.array(local))
            observed.append((twist[i, :3] + cross(twist[i, 3:], arm)) / mechanism.size)
    _, values, right = np.linalg.svd(np.concatenate(observed), full_matrices=True)
    count = int((values > REST).sum())
    if count == 1:
        return right[0] @ free, right[1:] @ free
    if count == 0:
        raise MobilityError(
            f"{mechanism.name} has no degree of freedom, so there is no curve to trace; add one",
            "overdetermined",
        )
    raise MobilityError(
        f"{mechanism.name}: {count} degrees of freedom are undetermined, and a curve has one; "
        f"lock or couple {count - 1} of them",
        "underdetermined",
    )
