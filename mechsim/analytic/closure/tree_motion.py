"""Where the links of a spanning tree are at given coordinates, and how each coordinate moves them.

Instants come last in every array here, so that each component is one run of memory.
"""

from dataclasses import dataclass

import numpy as np

from mechsim.analytic.closure.spanning_tree import SpanningTree
from mechsim.analytic.closure.tree_joints import TreeJoint
from mechsim.maths.arrays import Array

EYE = np.eye(3)[..., None]
# of three components those that come next, and those before
NEXT, BEFORE = np.array([1, 2, 0]), np.array([2, 0, 1])


@dataclass(frozen=True, slots=True)
class Coordinates:
    """Coordinates of a tree at n instants.

    Attributes:
        values: (count, n) in [m] and [rad]; those of a ball are not read. Complex where dimensions are.
        turns: of each ball, side b's frame in side a's, (balls, 3, 3, n).
    """

    values: Array
    turns: Array

    def __len__(self) -> int:
        return self.values.shape[1]


@dataclass(frozen=True, slots=True)
class Placed:
    """The links of a tree at n instants.

    Attributes:
        position: of each link's origin, (links, 3, n) in [m].
        rotation: (links, 3, 3, n).
        screws: what a unit rate of each coordinate is: velocity at the ground's origin and angular
            velocity, (count, 6, n).
    """

    position: Array
    rotation: Array
    screws: Array


def placed(tree: SpanningTree, at: Coordinates) -> Placed:
    """Return where coordinates put the links."""
    laid, n, kind = tree.layout, len(at), at.values.dtype
    # the ground comes last, where the index -1 finds it
    rotation = np.empty((len(tree.branches) + 1, 3, 3, n), kind)
    _turn(tree, at, rotation)
    rotation[-1] = EYE
    for far, near in laid.tiers:
        rotation[far] = np.einsum("lijn,ljkn->likn", rotation[near], rotation[far])
    carried = _carried(laid.vectors, rotation[laid.holders])
    fixed = carried.reshape(3, carried.shape[1] * carried.shape[2], n)
    axes = spins = fixed.take(laid.axes, 1)
    position = np.zeros((3, len(rotation), n), kind)
    np.subtract(fixed.take(laid.near, 1), carried[:, : len(tree.branches), 0], out=position[:, :-1])
    if len(laid.slides):
        along = axes[:, laid.slides]
        for link, way in zip(laid.slid, (along * at.values[laid.slides]).swapaxes(0, 1), strict=True):
            position[:, link] += way
        spins = axes.copy()
        spins[:, laid.slides] = 0.0
    for far, near in laid.tiers:
        position[:, far] += position[:, near]
    screws = np.empty((tree.count, 6, n), kind).transpose(1, 0, 2)
    screws[3:] = spins
    screws[:3] = cross(position.take(laid.centred, 1) + fixed.take(laid.centres, 1), spins)
    if len(laid.slides):
        screws[:3, laid.slides] = axes[:, laid.slides]
    return Placed(position[:, :-1].transpose(1, 0, 2), rotation[:-1], screws.transpose(1, 0, 2))


def _carried(vectors: Array, rotation: Array) -> Array:
    """Return rows of vectors, (rows, m, 3) or (rows, m, 3, n), as their links are turned: (3, rows, m, n)."""
    if vectors.ndim == 3:
        return vectors @ rotation.transpose(1, 0, 2, 3)
    return np.einsum("lmkn,likn->ilmn", vectors, rotation)


def _turn(tree: SpanningTree, at: Coordinates, out: Array) -> None:
    """Fill in how each link is turned in that on which it hangs, (links + 1, 3, 3, n)."""
    laid = tree.layout
    angle = at.values[laid.angles]
    terms = np.empty((len(angle), 3, len(at)), angle.dtype)
    terms[:, 0] = 1.0
    np.cos(angle, out=terms[:, 1])
    np.sin(angle, out=terms[:, 2])
    every = (
        laid.turning @ terms if laid.turning.ndim == 3 else np.einsum("haen,hen->han", laid.turning, terms)
    ).reshape(len(angle), 3, 3, len(at))
    out[laid.once[0]] = every[laid.once[1]]
    link, first, second = laid.twice
    if len(link):
        out[link] = np.einsum("lijn,ljkn->likn", every[first], every[second])
    for branch, ball in laid.stiff:
        fixed = tree.constants[branch.far]
        frame, back = (_wide(one) for one in (fixed.near_frame, fixed.far_frame.swapaxes(0, 1)))
        if ball is not None:
            turn = at.turns[ball]
            frame = product(frame, turn if branch.forward else turn.swapaxes(0, 1))
        out[branch.far] = product(frame, back)


def _wide(matrix: Array) -> Array:
    """Return a matrix (3, 3) as (3, 3, 1), or (3, 3, n) as it is."""
    return matrix[..., None] if matrix.ndim == 2 else matrix


def on_ground(frame: Array, point: Array) -> tuple[Array, Array]:
    """Return a frame and a point of the ground, as (3, 3, n) and (3, n) or with 1 for n."""
    return (frame[..., None], point[:, None]) if frame.ndim == 2 else (frame, point)


def carried_frame(frame: Array, turn: Array) -> Array:
    """Return a frame (3, 3) of a link, or (3, 3, n) of many designs, where the link is turned, (3, 3, n)."""
    return frame.T @ turn if frame.ndim == 2 else product(turn, frame)


def carried_point(point: Array, turn: Array) -> Array:
    """Return a point (3,) of a link, or (3, n) of many designs, where the link is turned, (3, n)."""
    return point @ turn if point.ndim == 1 else np.einsum("kn,ikn->in", point, turn)


def twists(tree: SpanningTree, here: Placed, rates: Array) -> Array:
    """Return each link's motion at coordinate rates (count, n): (links, 6, n), at the ground's origin."""
    return _summed(tree, here.screws * rates[:, None])


def drifts(tree: SpanningTree, here: Placed, twist: Array, rates: Array) -> Array:
    """Return the links' accelerations at coordinate rates that do not change, (links, 6, n), as `twists`."""
    change = np.empty_like(here.screws)
    still = np.zeros(twist.shape[1:])
    for branch in tree.branches:
        near, far = still if branch.near < 0 else twist[branch.near], twist[branch.far]
        a, b = (near, far) if branch.forward else (far, near)
        kind, k = branch.kind, branch.first
        for axis in (*kind.slides, *kind.turns):
            # fixed in a: slides, the axes of a ball, the first of two that cross; else in b
            in_a = k < branch.turning or kind.ball or (kind.crossed and axis == "a")
            w, s = a if in_a else b, here.screws[k]
            change[k, 3:] = cross(w[3:], s[3:])
            if k >= branch.turning and kind.slides and kind.ball:
                # the axis passes through b's point, but is carried along by a
                centre = _centre(tree, branch, here)
                change[k, :3] = cross(b[:3] + cross(b[3:], centre), s[3:]) + cross(centre, change[k, 3:])
            else:
                change[k, :3] = cross(w[3:], s[:3]) + cross(w[:3], s[3:])
            k += 1
    change *= rates[:, None]
    return _summed(tree, change)


def _centre(tree: SpanningTree, branch: TreeJoint, here: Placed) -> Array:
    """Return where side b's point of a branch is, (3, n) or (3, 1)."""
    fixed = tree.constants[branch.far]
    link, point = (branch.far, fixed.far_point) if branch.forward else (branch.near, fixed.near_point)
    if link < 0:
        return point[:, None] if point.ndim == 1 else point
    return here.position[link] + carried_point(point, here.rotation[link])


def _summed(tree: SpanningTree, of: Array) -> Array:
    """Return for each link the sum over the coordinates that move it, (links, 6, n)."""
    total = np.empty((len(tree.branches), *of.shape[1:]), of.dtype)
    for branch in tree.branches:
        if not branch.kind.freedoms:
            total[branch.far] = 0.0 if branch.near < 0 else total[branch.near]
            continue
        own = of[branch.first]
        for k in range(branch.first + 1, branch.first + branch.kind.freedoms):
            own = own + of[k]
        total[branch.far] = own if branch.near < 0 else total[branch.near] + own
    return total


def product(a: Array, b: Array) -> Array:
    """Return matrix products of (3, 3, n)."""
    return np.einsum("ijn,jkn->ikn", a, b)


def cross(a: Array, b: Array) -> Array:
    """Return vector products, (3, n) or with more axes between."""
    found = a.take(NEXT, 0) * b.take(BEFORE, 0)
    found -= a.take(BEFORE, 0) * b.take(NEXT, 0)
    return found
