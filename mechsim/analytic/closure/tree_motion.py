"""Where the links of a spanning tree are at given coordinates, and how each coordinate moves them.

Instants come last in every array here, so that each component is one run of memory.
"""

from dataclasses import dataclass
from functools import reduce

import numpy as np

from mechsim.analytic.closure.spanning_tree import SpanningTree, TreeJoint
from mechsim.maths.arrays import Array

EYE = np.eye(3)[..., None]


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
    n, links = len(at), len(tree.branches)
    kind = at.values.dtype
    # the ground comes last, where the index -1 finds it
    position, rotation = np.zeros((links + 1, 3, n), kind), np.empty((links + 1, 3, 3, n), kind)
    rotation[-1] = EYE
    screws, centres = np.zeros((tree.count, 6, n), kind), np.zeros((3, tree.count, n), kind)
    turns = _turns(tree, at)
    for branch in tree.branches:
        fixed, near = tree.constants[branch.far], rotation[branch.near]
        turned = turns[branch.far] if branch.near < 0 else [near, *turns[branch.far]]
        rotation[branch.far] = reduce(product, turned)
        point = position[branch.near] + carried_point(fixed.near_point, near)
        there = point
        for k, axis in enumerate(branch.kind.slides, branch.first):
            link, along = fixed.axis(branch, axis)
            screws[k, :3] = branch.sense * carried_point(along, rotation[link])
            there = there + screws[k, :3] * at.values[k]
        for k, axis in enumerate(branch.kind.turns, branch.turning):
            link, about = fixed.axis(branch, axis)
            screws[k, 3:] = carried_point(branch.sense * about, rotation[link])
            # axes pass through side b's point
            centres[:, k] = there if branch.forward else point
        position[branch.far] = there - carried_point(fixed.far_point, rotation[branch.far])
    screws[:, :3] += cross(centres, screws[:, 3:].transpose(1, 0, 2)).transpose(1, 0, 2)
    return Placed(position[:-1], rotation[:-1], screws)


def _turns(tree: SpanningTree, at: Coordinates) -> dict[int, list[Array]]:
    """Return the turns that lead from each near link's axes to the far link's, one after the other."""
    angle = at.values[tree.angles]
    terms = np.empty((len(angle), 3, len(at)), angle.dtype)
    terms[:, 0] = 1.0
    np.cos(angle, out=terms[:, 1])
    np.sin(angle, out=terms[:, 2])
    every = (
        tree.turning @ terms if tree.turning.ndim == 3 else np.einsum("haen,hen->han", tree.turning, terms)
    )
    counted, balls = iter(every.reshape(len(angle), 3, 3, len(at))), iter(at.turns)
    found: dict[int, list[Array]] = {}
    for branch in tree.branches:
        if branch.angles:
            found[branch.far] = [next(counted) for _ in branch.angles]
            continue
        fixed = tree.constants[branch.far]
        frame, back = (_wide(one) for one in (fixed.near_frame, fixed.far_frame.swapaxes(0, 1)))
        if branch.kind.ball:
            turn = next(balls)
            frame = product(frame, turn if branch.forward else turn.swapaxes(0, 1))
        found[branch.far] = [product(frame, back)]
    return found


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
    first = a[1] * b[2] - a[2] * b[1]
    out = np.empty((3, *first.shape), first.dtype)
    out[0] = first
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    return out
