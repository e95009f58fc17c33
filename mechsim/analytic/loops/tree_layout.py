"""A spanning tree as arrays: what its links are placed by, many at once."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.loops.tree_joints import JointSides, TreeJoint
from mechsim.numerics.arrays import Array

Indices = NDArray[np.intp]
# indices, as a slice where they lie in a row
Index = slice | Indices
# vectors in a row at the most: what holds more takes several
MAX_VECTORS = 8


@dataclass(frozen=True, slots=True)
class Layout:
    """What the links of a tree are placed by; index -1 is the ground.

    Attributes:
        angles: indices of the angles among the coordinates.
        rotations: how each turns a link, in terms of 1, its cosine and its sine, (angles, 9, 3), or
            (angles, 9, 3, n) of many designs.
        single: links that one angle turns in that on which they hang, and which of the angles.
        double: likewise of two, the first nearer the frame.
        stiff: branches without angles, each with the index of its ball, if any.
        tiers: links that hang on moving ones and those on which they do, nearest the frame first.
        vectors: what is fixed on links, in their frames, padded with noughts, (rows, m, 3), or
            (rows, m, 3, n). A row for each link and the ground, its branch's point first; then others.
        holders: the links of the rows.
        parent_points: for each link, the index of its branch's point on its parent; indices count
            through all rows.
        axes: places of the axes of all coordinates, as the farther link moves along or about them.
        centres: of a point on each of these axes.
        centred: the links on which these are fixed.
        slides: indices of the coordinates that are displacements.
        slid: links that these move in those on which they hang.
    """

    angles: Index
    rotations: Array
    single: tuple[Index, Index]
    double: tuple[Indices, Indices, Indices]
    stiff: tuple[tuple[TreeJoint, int | None], ...]
    tiers: tuple[tuple[Index, Index], ...]
    vectors: Array
    holders: Index
    parent_points: Indices
    axes: Indices
    centres: Indices
    centred: Indices
    slides: Indices
    slid: Indices


def layout(branches: Sequence[TreeJoint], constants: Mapping[int, JointSides]) -> Layout:
    """Return the layout of a tree, its branches nearest the frame first.

    Args:
        branches: by which joint each link is placed.
        constants: index of a link -> the sides of the branch that places it.
    """
    slides = [(k, branch.child) for branch in branches for k in range(branch.first, branch.first_angle)]
    sliding, slid = np.array(slides, dtype=np.intp).reshape(-1, 2).T
    return Layout(
        *_angles(branches, constants),
        _tiers(branches),
        *_vectors(branches, constants),
        sliding,
        slid,
    )


def as_slice(indices: Indices) -> Index:
    """Return indices as a slice where each is one more than that before: no copy is then made."""
    values = indices.tolist()
    consecutive = len(values) > 0 and values == [*range(values[0], values[0] + len(values))]
    return slice(values[0], values[-1] + 1) if consecutive else indices


def block(rows: Indices, columns: Indices) -> tuple[Index, ...]:
    """Return what picks rows and columns of a matrix: slices where both lie in a row."""
    selectors = as_slice(rows), as_slice(columns)
    return selectors if all(isinstance(selector, slice) for selector in selectors) else np.ix_(rows, columns)


def _angles(
    branches: Sequence[TreeJoint], constants: Mapping[int, JointSides]
) -> tuple[
    Index,
    Array,
    tuple[Index, Index],
    tuple[Indices, Indices, Indices],
    tuple[tuple[TreeJoint, int | None], ...],
]:
    """Return the first five of a layout."""
    by_link = sorted(branches, key=lambda branch: branch.child)
    angles = [angle for branch in by_link for angle in branch.angles]
    terms = [
        term for branch in by_link if branch.angles for term in constants[branch.child].rotations(branch)
    ]
    rotations = np.array(terms)
    first = np.cumsum([0, *(len(branch.angles) for branch in by_link)])
    single, double = (
        np.array([i for i, branch in enumerate(by_link) if len(branch.angles) == k], dtype=np.intp)
        for k in (1, 2)
    )
    balls = count()
    stiff = ((joint, next(balls) if joint.kind.ball else None) for joint in branches if not joint.angles)
    return (
        as_slice(np.array(angles, dtype=np.intp)),
        rotations.reshape(len(terms), 9, 3, *rotations.shape[4:]),
        (as_slice(single), as_slice(first[single])),
        (double, first[double], first[double] + 1),
        tuple(stiff),
    )


def _tiers(branches: Sequence[TreeJoint]) -> tuple[tuple[Index, Index], ...]:
    depth, parent = np.zeros((2, len(branches) + 1), dtype=np.intp)
    for branch in branches:
        depth[branch.child], parent[branch.child] = depth[branch.parent] + 1, branch.parent
    tiers = (np.flatnonzero(depth == k) for k in range(2, int(depth.max()) + 1))
    return tuple((as_slice(child), as_slice(parent[child])) for child in tiers)


def _vectors(
    branches: Sequence[TreeJoint], constants: Mapping[int, JointSides]
) -> tuple[Array, Index, Indices, Indices, Indices, Indices]:
    """Return what is fixed on the links, and where of it points, axes and centres are."""
    rows = [[constants[i].child_point] for i in range(len(branches))]
    rows.append([np.zeros_like(rows[0][0]) if rows else np.zeros(3)])
    holders = [*range(len(rows))]
    last = [*holders]

    def position_of(link: int, vector: Array) -> tuple[int, int]:
        if len(rows[last[link]]) == MAX_VECTORS:
            last[link] = len(rows)
            rows.append([])
            holders.append(link % (len(branches) + 1))
        row = rows[last[link]]
        row.append(vector)
        return last[link], len(row) - 1

    parent_points = [(0, 0)] * len(branches)
    axes, centres, centred = list[tuple[int, int]](), list[tuple[int, int]](), list[int]()
    for branch in branches:
        i, fixed, kind = branch.child, constants[branch.child], branch.kind
        parent_points[i] = position_of(branch.parent, fixed.parent_point)
        for axis in (*kind.slides, *kind.turns):
            link, direction = fixed.axis(branch, axis)
            axes.append(position_of(link, branch.direction * direction))
            # axes pass through side b's point
            centres.append((i, 0) if branch.forward else parent_points[i])
            centred.append(i if branch.forward else branch.parent)
    longest, zero = max(map(len, rows)), rows[len(branches)][0]
    vectors = np.array([row + [zero] * (longest - len(row)) for row in rows])
    first, second, third = (
        np.array(pairs, dtype=np.intp).reshape(-1, 2) @ [longest, 1]
        for pairs in (parent_points, axes, centres)
    )
    return vectors, as_slice(np.array(holders)), first, second, third, np.array(centred, dtype=np.intp)
