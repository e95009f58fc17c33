"""Minimum-norm solutions of sparse equations A x = b and the null space of A, by blocks of rows.

Each step transforms the columns that a block of rows touches by an orthogonal matrix, so that the first ones
solve the block and the others vanish in it: A V = L with orthogonal V and block lower triangular L. No block
on the diagonal of L is closer to a singular one than A is. Blocks that touch the fewest others come first.

Source: G. Golub, C. Van Loan, Matrix Computations (2013), section 5.6; T. Davis, Direct Methods for Sparse
Linear Systems (2006), chapter 7.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from itertools import accumulate, pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mechsim.numerics.arrays import Array
from mechsim.numerics.graphs import components
from mechsim.numerics.rank import RANK_TOLERANCE

# a block of rows, and the connected component of A that these rows of it belong to
Block = tuple[int, int]
# transformed columns: block of rows -> its entries, (n, rows, columns)
Columns = dict[Block, Array]


@dataclass(frozen=True, slots=True)
class LeastNorm:
    """Minimum-norm solutions of n sets of equations with m unknowns.

    Attributes:
        solution: (n, m, k).
        nullity: dimension of the null space.
        null: for each cluster of unknowns its components of the null vectors, (n, unknowns, s), apart from
            an orthogonal matrix on their right.
        complete: where the null space is no larger, (n,).
    """

    solution: Array
    nullity: int
    null: list[Array]
    complete: NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class _Step:
    """Elimination of a block: the groups of columns it touches, and their transformation.

    Attributes:
        groups: numbers of these groups.
        counts: their numbers of columns.
        basis: the orthogonal matrix, (n, sum of counts, sum of counts).
        pivots: coefficients of its first columns, (n, rank, k).
        kept: number of the next ones, which form a new group; the others are null vectors.
    """

    groups: list[int]
    counts: list[int]
    basis: Array
    pivots: Array
    kept: int


def block_least_norm(
    columns: Sequence[Mapping[int, Array]], clusters: Sequence[Sequence[int]], right: Array
) -> LeastNorm:
    """Return the minimum-norm solutions of sparse equations, and their null space by clusters of unknowns.

    Args:
        columns: for each unknown block of rows -> its column there, (n, size).
        clusters: unknowns by clusters, each in one; those of one should touch the same blocks.
        right: right-hand sides, (n, blocks, size, k).
    """
    n, _, _, k = right.shape
    row_labels, labels = _components(columns, *right.shape[1:3])
    groups: list[Columns] = []
    numbers: list[tuple[int, NDArray[np.intp]]] = []
    for cluster, members in enumerate(clusters):
        for label in sorted({int(labels[e]) for e in members}):
            which = np.array([e for e in members if labels[e] == label])
            numbers.append((cluster, which))
            groups.append(_columns(columns, which, row_labels, label))
    rest = {
        block: right[:, block[0], row_labels[block[0]] == block[1]] for group in groups for block in group
    }
    free = [i for i, group in enumerate(groups) if not group]
    steps, weak = _eliminated(groups, rest, n)
    nothing = np.zeros((n, 0, k)), np.zeros((n, 0, 0))
    # columns that touch no rows are null vectors
    solved = {
        i: (np.zeros((n, count, k)), np.broadcast_to(np.eye(count), (n, count, count)))
        for i, count in ((i, len(numbers[i][1])) for i in free)
    }
    nullity = sum(len(numbers[i][1]) for i in solved)
    for i in range(len(steps) - 1, -1, -1):
        step = steps[i]
        above, null = solved.pop(len(numbers) + i, nothing)
        rank, kept = step.pivots.shape[1], step.pivots.shape[1] + step.kept
        whole = step.basis[:, :, :kept] @ np.concatenate([step.pivots, above], 1)
        null = np.concatenate([step.basis[:, :, rank:kept] @ null, step.basis[:, :, kept:]], 2)
        nullity += step.basis.shape[2] - kept
        for group, (first, last) in zip(
            step.groups, pairwise(accumulate(step.counts, initial=0)), strict=True
        ):
            solved[group] = whole[:, first:last], _compressed(null[:, first:last])
    solution = np.zeros((n, len(columns), k))
    own: list[list[tuple[NDArray[np.intp], Array]]] = [[] for _ in clusters]
    for i, (cluster, which) in enumerate(numbers):
        solution[:, which], null = solved[i]
        own[cluster].append((np.searchsorted(clusters[cluster], which), null))
    return LeastNorm(solution, nullity, [_side_by_side(n, each) for each in own], ~weak)


def _components(
    columns: Sequence[Mapping[int, Array]], blocks: int, height: int
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the connected component of A to which each row, (blocks, height), and each column belongs."""
    rows, count = blocks * height, blocks * height + len(columns)
    touched = [(block, rows + e) for e, column in enumerate(columns) for block in column]
    nonzero = np.stack([values for column in columns for values in column.values()]).any(1)
    which, within = (each.tolist() for each in np.nonzero(nonzero))
    edges = [(touched[k][0] * height + i, touched[k][1]) for k, i in zip(which, within, strict=True)]
    labels = np.empty(count, dtype=np.intp)
    for label, members in enumerate(components(range(count), edges)):
        labels[[*members]] = label
    return labels[:rows].reshape(blocks, height), labels[rows:]


def _columns(
    columns: Sequence[Mapping[int, Array]], which: NDArray[np.intp], row_labels: NDArray[np.intp], label: int
) -> Columns:
    """Return some columns, which are in one component."""
    result: Columns = {}
    for block in sorted({block for e in which for block in columns[e]}):
        rows = np.flatnonzero(row_labels[block] == label)
        if len(rows):
            zero = np.zeros_like(next(iter(columns[which[0]].values())))
            result[block, label] = np.stack([columns[e].get(block, zero)[:, rows] for e in which], 2)
    return result


def _eliminated(
    groups: list[Columns], rest: dict[Block, Array], n: int
) -> tuple[list[_Step], NDArray[np.bool_]]:
    """Eliminate all blocks, and return the steps and at which instants A has a smaller rank, (n,).

    Each step appends a group of columns, and empties those that it transforms. `rest` are the right-hand
    sides less the contributions of the pivots, and is changed.
    """
    touching = {block: set[int]() for block in rest}
    for i, block in ((i, block) for i, group in enumerate(groups) for block in group):
        touching[block].add(i)
    scale = _scales(groups, n)

    def degree(block: Block) -> int:
        return len({other for i in touching[block] for other in groups[i]})

    waiting = [(degree(block), block) for block in touching]
    heapify(waiting)
    steps, weak = list[_Step](), np.zeros(n, dtype=np.bool_)
    while waiting:
        least, block = heappop(waiting)
        if block not in touching or least != degree(block):
            # eliminated, or waiting with another degree
            continue
        own = sorted(touching.pop(block))
        if not own:
            continue
        counts = [groups[i][block].shape[2] for i in own]
        joined = _joined([groups[i] for i in own], counts)
        for i in own:
            groups[i] = {}
        basis, pivots, fewer = _pivots(joined.pop(block), rest.pop(block), scale[block[1]])
        rank, weak = pivots.shape[1], weak | fewer
        for other, values in joined.items():
            moved = values @ basis
            rest[other] = rest[other] - moved[:, :, :rank] @ pivots
            joined[other] = moved[:, :, rank:]
        rotation, left = _without_null_vectors(joined)
        if rotation is not None:
            basis = np.concatenate([basis[:, :, :rank], basis[:, :, rank:] @ rotation], 2)
        kept = next((values.shape[2] for values in left.values()), 0)
        steps.append(_Step(own, counts, basis, pivots, kept))
        groups.append(left if kept else {})
        for other in left:
            touching[other] = touching[other].difference(own) | ({len(groups) - 1} if kept else set())
            heappush(waiting, (degree(other), other))
    return steps, weak


def _scales(groups: Sequence[Columns], n: int) -> dict[int, Array]:
    """Return the largest Frobenius norm of a block of rows of each component, (n,)."""
    squares, scales = dict[Block, Array](), dict[int, Array]()
    for group in groups:
        for block, values in group.items():
            squares[block] = squares.get(block, np.zeros(n)) + (values**2).sum((1, 2))
    for (_, label), square in squares.items():
        scales[label] = np.maximum(scales.get(label, 0.0), np.sqrt(square))
    return scales


def _joined(groups: Sequence[Columns], counts: Sequence[int]) -> Columns:
    """Return groups of columns next to each other, from their numbers of columns."""
    result: Columns = {}
    for block in sorted({block for group in groups for block in group}):
        n, rows, _ = next(group[block] for group in groups if block in group).shape
        both = zip(groups, counts, strict=True)
        result[block] = np.concatenate(
            [group[block] if block in group else np.zeros((n, rows, count)) for group, count in both], 2
        )
    return result


def _without_null_vectors(columns: Columns) -> tuple[Array | None, Columns]:
    """Return an orthogonal matrix whose last columns combine columns to null vectors, and the others.

    There are null vectors for certain where columns outnumber rows; otherwise the matrix is None.
    """
    rows = sum(values.shape[1] for values in columns.values())
    if not columns or next(iter(columns.values())).shape[2] <= rows:
        return None, columns
    rotation, _ = np.linalg.qr(np.concatenate([*columns.values()], 1).swapaxes(1, 2), mode="complete")
    return rotation, {block: (values @ rotation)[:, :, :rows] for block, values in columns.items()}


def _pivots(matrix: Array, right: Array, scale: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return orthogonal V (n, p, p) whose last columns vanish in a block, (n, rows, p).

    Also return the coefficients (n, rank, k) of its first columns, which solve the block, and where the rank
    is smaller, (n,). Singular values are zero below `RANK_TOLERANCE` of `scale`, (n,).
    """
    rows = matrix.shape[1]
    if rows <= matrix.shape[2]:
        basis, upper = np.linalg.qr(matrix.swapaxes(1, 2), mode="complete")
        lower = upper[:, :rows].swapaxes(1, 2)
        if (np.abs(np.diagonal(lower, axis1=1, axis2=2)) > RANK_TOLERANCE * scale[:, None]).all():
            inverse = np.linalg.inv(lower)
            # the norm of the inverse is a bound of the least singular value
            if (np.linalg.norm(inverse, axis=(1, 2)) * RANK_TOLERANCE * scale < 1.0).all():
                return basis, inverse @ right, np.zeros(len(scale), dtype=np.bool_)
    u, values, vt = np.linalg.svd(matrix, full_matrices=True)
    nonzero = values > RANK_TOLERANCE * scale[:, None]
    rank = int(nonzero.sum(1).max())
    weak = nonzero.sum(1) < rank
    nonzero = nonzero[:, :rank, None]
    solved = u[:, :, :rank].swapaxes(1, 2) @ right / np.where(nonzero, values[:, :rank, None], 1.0)
    return vt.swapaxes(1, 2), np.where(nonzero, solved, 0.0), weak


def _compressed(null: Array) -> Array:
    """Return components of null vectors, (n, p, s), with p columns at the most and the same products C C'."""
    if null.shape[2] <= null.shape[1]:
        return null
    triangular: Any = np.linalg.qr(null.swapaxes(1, 2), mode="r")
    return triangular.swapaxes(1, 2)


def _side_by_side(n: int, blocks: Sequence[tuple[NDArray[np.intp], Array]]) -> Array:
    """Return the null vectors of all components of a cluster, from rows and values of each component."""
    result = np.zeros((n, sum(len(rows) for rows, _ in blocks), sum(null.shape[2] for _, null in blocks)))
    first = 0
    for rows, null in blocks:
        result[:, rows, first : first + null.shape[2]] = null
        first += null.shape[2]
    return result
