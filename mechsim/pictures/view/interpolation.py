"""Poses between nodes, as the page finds them: cubics through the four nearest nodes of each slider."""

from collections.abc import Sequence

import numpy as np

from mechsim.numerics.arrays import Array
from mechsim.pictures.view.records import Slider

# nodes that a cubic goes through
STENCIL = 4


def quaternions(rotation: Array) -> Array:
    """Return unit quaternions of rotations, (..., 3, 3) -> (..., 4), scalar first and not negative."""
    m = rotation
    trace = np.trace(m, axis1=-2, axis2=-1)
    diagonal = np.diagonal(m, axis1=-2, axis2=-1)
    # four times the square of each component; the largest is divided by
    squares = np.concatenate([1.0 + trace[..., None], 1.0 - trace[..., None] + 2.0 * diagonal], -1)
    table = np.empty((*m.shape[:-2], 4, 4))
    table[..., range(4), range(4)] = squares
    for (i, j), value in {
        (0, 1): m[..., 2, 1] - m[..., 1, 2],
        (0, 2): m[..., 0, 2] - m[..., 2, 0],
        (0, 3): m[..., 1, 0] - m[..., 0, 1],
        (1, 2): m[..., 0, 1] + m[..., 1, 0],
        (1, 3): m[..., 0, 2] + m[..., 2, 0],
        (2, 3): m[..., 1, 2] + m[..., 2, 1],
    }.items():
        table[..., i, j] = table[..., j, i] = value
    row = np.argmax(squares, -1)[..., None, None]
    found = np.take_along_axis(table, row, -2)[..., 0, :]
    found = found / np.sqrt((found**2).sum(-1, keepdims=True))
    return np.where(found[..., :1] < 0.0, -found, found)


def stencil(slider: Slider, value: float) -> tuple[list[int], list[float]]:
    """Return the nodes of a slider about a value, four where there are so many, and their weights.

    A ring goes on past its ends; its last node is its first.
    """
    nodes, n = slider.nodes, len(slider.nodes)
    low = int(np.clip(np.searchsorted(nodes, value, side="right") - 1, 0, max(n - 2, 0)))
    count = min(STENCIL, n)
    if slider.ring:
        period, places = nodes[-1] - nodes[0], range(low - 1, low - 1 + count)
        laps = [i // (n - 1) for i in places]
        at = [i % (n - 1) for i in places]
        where = [float(nodes[i] + period * lap) for i, lap in zip(at, laps, strict=True)]
    else:
        first = int(np.clip(low - 1, 0, n - count))
        at = list(range(first, first + count))
        where = [float(nodes[i]) for i in at]
    weights = [
        float(np.prod([(value - b) / (a - b) for k, b in enumerate(where) if k != j]))
        for j, a in enumerate(where)
    ]
    return at, weights


def interpolated(
    sliders: Sequence[Slider], values: Array, at: Sequence[float], *, turns: bool = False
) -> Array:
    """Return values of a grid, (*shape, c), at a setting of its sliders, (c,).

    Args:
        sliders: of the grid.
        values: at the nodes.
        at: a value for each slider.
        turns: whether the values are quaternions, of which both signs mean one turn.
    """
    places = [stencil(slider, value) for slider, value in zip(sliders, at, strict=True)]
    block = values[np.ix_(*(nodes for nodes, _ in places))]
    if turns:
        first = block.reshape(-1, block.shape[-1])[0]
        block = np.where((block @ first)[..., None] < 0.0, -block, block)
    for _, weights in places:
        block = np.tensordot(np.array(weights), block, axes=(0, 0))
    return block / np.linalg.norm(block) if turns else block
