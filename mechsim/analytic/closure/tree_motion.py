"""Where the links of a spanning tree are at given coordinates, and how each coordinate moves them.

Instants come last in every array here, so that each component is one run of memory.
"""

from dataclasses import dataclass

import numpy as np

from mechsim.analytic.closure.spanning_tree import SpanningTree, TreeJoint
from mechsim.maths.arrays import Array
from mechsim.model.joints import COLUMN, crossed_at_zero


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
    position, rotation = np.empty((links, 3, n), kind), np.empty((links, 3, 3, n), kind)
    screws = np.zeros((tree.count, 6, n), kind)
    ball = 0
    for branch in tree.branches:
        fixed = tree.constants[branch.far]
        if branch.near < 0:
            frame, point = on_ground(fixed.near_frame, fixed.near_point)
        else:
            turn = rotation[branch.near]
            frame = carried_frame(fixed.near_frame, turn)
            point = position[branch.near] + carried_point(fixed.near_point, turn)
        if branch.kind.ball:
            other = product(frame, at.turns[ball] if branch.forward else at.turns[ball].transpose(1, 0, 2))
            ball += 1
        else:
            other = _turned(branch, frame, at.values)
        frame_a, frame_b = (frame, other) if branch.forward else (other, frame)
        sense = 1.0 if branch.forward else -1.0
        there, k = point, branch.first
        for axis in branch.kind.slides:
            along = frame_a[:, COLUMN[axis]]
            there = there + along * (sense * at.values[k])
            screws[k, :3] = sense * along
            k += 1
        # axes pass through side b's point
        centre = there if branch.forward else point
        for axis in branch.kind.turns:
            about = (frame_b if axis == "b" else frame_a)[:, COLUMN[axis]]
            screws[k, 3:] = about if branch.forward else -about
            screws[k, :3] = cross(centre, screws[k, 3:])
            k += 1
        rotation[branch.far] = _turn_of(fixed.far_frame, other)
        position[branch.far] = there - carried_point(fixed.far_point, rotation[branch.far])
    return Placed(position, rotation, screws)


def on_ground(frame: Array, point: Array) -> tuple[Array, Array]:
    """Return a frame and a point of the ground, as (3, 3, n) and (3, n) or with 1 for n."""
    return (frame[..., None], point[:, None]) if frame.ndim == 2 else (frame, point)


def carried_frame(frame: Array, turn: Array) -> Array:
    """Return a frame (3, 3) of a link, or (3, 3, n) of many designs, where the link is turned, (3, 3, n)."""
    return frame.T @ turn if frame.ndim == 2 else product(turn, frame)


def carried_point(point: Array, turn: Array) -> Array:
    """Return a point (3,) of a link, or (3, n) of many designs, where the link is turned, (3, n)."""
    return point @ turn if point.ndim == 1 else np.einsum("kn,ikn->in", point, turn)


def _turn_of(frame: Array, placed: Array) -> Array:
    """Return the turn of a link (3, 3, n) from where one of its frames is placed."""
    return frame @ placed if frame.ndim == 2 else np.einsum("jkn,ikn->ijn", frame, placed)


def _turned(branch: TreeJoint, frame: Array, values: Array) -> Array:
    """Return the far side's joint frame, (3, 3, n), from the near side's."""
    kind = branch.kind
    angles = values[branch.first + len(kind.slides) :]
    if kind.crossed:
        middle = crossed_at_zero(branch.joint.cross_angle)
        if branch.forward:
            return _about_z(middle.T @ _about_z(frame, angles[0]), angles[1])
        return _about_z(middle @ _about_z(frame, -angles[1]), -angles[0])
    if kind.turns:
        return _about_z(frame, angles[0] if branch.forward else -angles[0])
    return frame


def _about_z(frame: Array, angle: Array) -> Array:
    """Return frames (3, 3, n) turned about their own third axis."""
    c, s = np.cos(angle), np.sin(angle)
    out = np.empty((3, 3, len(angle)), np.result_type(frame, angle))
    x, y = frame[:, 0], frame[:, 1]
    np.add(c * x, s * y, out=out[:, 0])
    np.subtract(c * y, s * x, out=out[:, 1])
    out[:, 2] = frame[:, 2]
    return out


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
