"""A spanning tree as arrays: what its links are placed by, many at once."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.closure.tree_joints import Fixed, TreeJoint
from mechsim.maths.arrays import Array

Indices = NDArray[np.intp]
# indices, as a slice where they lie in a row
Some = slice | Indices
# vectors in a row at the most: what holds more takes several
MOST = 8


@dataclass(frozen=True, slots=True)
class Layout:
    """What the links of a tree are placed by; index -1 is the ground.

    Attributes:
        angles: indices of the angles among the coordinates.
        turning: how each turns a link, in terms of 1, its cosine and its sine, (angles, 9, 3), or
            (angles, 9, 3, n) of many designs.
        once: links that one angle turns in that on which they hang, and which of the angles.
        twice: likewise of two, the first nearer the frame.
        stiff: branches without angles, each with the index of its ball, if any.
        tiers: links that hang on moving ones and those on which they do, nearest the frame first.
        vectors: what is fixed on links, in their frames, padded with noughts, (rows, m, 3), or
            (rows, m, 3, n). A row for each link and the ground, its branch's point first; then others.
        holders: the links of the rows.
        near: for each link its branch's point on that on which it hangs; places are counted through all rows.
        axes: places of the axes of all coordinates, as the farther link moves along or about them.
        centres: of a point on each of these axes.
        centred: the links on which these are fixed.
        slides: indices of the coordinates that are displacements.
        slid: links that these move in those on which they hang.
    """

    angles: Some
    turning: Array
    once: tuple[Some, Some]
    twice: tuple[Indices, Indices, Indices]
    stiff: tuple[tuple[TreeJoint, int | None], ...]
    tiers: tuple[tuple[Some, Some], ...]
    vectors: Array
    holders: Some
    near: Indices
    axes: Indices
    centres: Indices
    centred: Indices
    slides: Indices
    slid: Indices


def layout(branches: Sequence[TreeJoint], constants: Mapping[int, Fixed]) -> Layout:
    """Return the layout of a tree, its branches nearest the frame first.

    Args:
        branches: by which joint each link is placed.
        constants: index of a link -> the sides of the branch that places it.
    """
    slides = [(k, branch.far) for branch in branches for k in range(branch.first, branch.turning)]
    sliding, slid = np.array(slides, dtype=np.intp).reshape(-1, 2).T
    return Layout(
        *_angles(branches, constants),
        _tiers(branches),
        *_vectors(branches, constants),
        sliding,
        slid,
    )


def in_a_row(indices: Indices) -> Some:
    """Return indices as a slice where each is one more than that before: no copy is then made."""
    places = indices.tolist()
    row = len(places) > 0 and places == [*range(places[0], places[0] + len(places))]
    return slice(places[0], places[-1] + 1) if row else indices


def block(rows: Indices, columns: Indices) -> tuple[Some, ...]:
    """Return what picks rows and columns of a matrix: slices where both lie in a row."""
    found = in_a_row(rows), in_a_row(columns)
    return found if all(isinstance(one, slice) for one in found) else np.ix_(rows, columns)


def _angles(
    branches: Sequence[TreeJoint], constants: Mapping[int, Fixed]
) -> tuple[
    Some,
    Array,
    tuple[Some, Some],
    tuple[Indices, Indices, Indices],
    tuple[tuple[TreeJoint, int | None], ...],
]:
    """Return the first five of a layout."""
    by_link = sorted(branches, key=lambda branch: branch.far)
    angles = [angle for branch in by_link for angle in branch.angles]
    parts = [part for branch in by_link if branch.angles for part in constants[branch.far].turning(branch)]
    turning = np.array(parts)
    first = np.cumsum([0, *(len(branch.angles) for branch in by_link)])
    once, twice = (
        np.array([i for i, branch in enumerate(by_link) if len(branch.angles) == k], dtype=np.intp)
        for k in (1, 2)
    )
    balls = count()
    stiff = ((one, next(balls) if one.kind.ball else None) for one in branches if not one.angles)
    return (
        in_a_row(np.array(angles, dtype=np.intp)),
        turning.reshape(len(parts), 9, 3, *turning.shape[4:]),
        (in_a_row(once), in_a_row(first[once])),
        (twice, first[twice], first[twice] + 1),
        tuple(stiff),
    )


def _tiers(branches: Sequence[TreeJoint]) -> tuple[tuple[Some, Some], ...]:
    depth, near = np.zeros((2, len(branches) + 1), dtype=np.intp)
    for branch in branches:
        depth[branch.far], near[branch.far] = depth[branch.near] + 1, branch.near
    tiers = (np.flatnonzero(depth == k) for k in range(2, int(depth.max()) + 1))
    return tuple((in_a_row(far), in_a_row(near[far])) for far in tiers)


def _vectors(
    branches: Sequence[TreeJoint], constants: Mapping[int, Fixed]
) -> tuple[Array, Some, Indices, Indices, Indices, Indices]:
    """Return what is fixed on the links, and where of it points, axes and centres are."""
    rows = [[constants[i].far_point] for i in range(len(branches))]
    rows.append([np.zeros_like(rows[0][0]) if rows else np.zeros(3)])
    holders = [*range(len(rows))]
    last = [*holders]

    def added(link: int, vector: Array) -> tuple[int, int]:
        if len(rows[last[link]]) == MOST:
            last[link] = len(rows)
            rows.append([])
            holders.append(link % (len(branches) + 1))
        row = rows[last[link]]
        row.append(vector)
        return last[link], len(row) - 1

    near = [(0, 0)] * len(branches)
    axes, centres, centred = list[tuple[int, int]](), list[tuple[int, int]](), list[int]()
    for branch in branches:
        i, fixed, kind = branch.far, constants[branch.far], branch.kind
        near[i] = added(branch.near, fixed.near_point)
        for axis in (*kind.slides, *kind.turns):
            link, along = fixed.axis(branch, axis)
            axes.append(added(link, branch.sense * along))
            # axes pass through side b's point
            centres.append((i, 0) if branch.forward else near[i])
            centred.append(i if branch.forward else branch.near)
    longest, nothing = max(map(len, rows)), rows[len(branches)][0]
    vectors = np.array([row + [nothing] * (longest - len(row)) for row in rows])
    first, second, third = (
        np.array(pairs, dtype=np.intp).reshape(-1, 2) @ [longest, 1] for pairs in (near, axes, centres)
    )
    return vectors, in_a_row(np.array(holders)), first, second, third, np.array(centred, dtype=np.intp)
