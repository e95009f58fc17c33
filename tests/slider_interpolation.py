"""Cubic interpolation between the poses of a page, as its script does it."""

import numpy as np

# number of nodes of cubic interpolation
STENCIL = 4


def stencil(slider, value):
    """Return the nodes of a slider next to a value, four if there are as many, and their weights.

    A ring goes on past its ends; its last node is its first.
    """
    nodes, n = slider.nodes, len(slider.nodes)
    low = int(np.clip(np.searchsorted(nodes, value, side="right") - 1, 0, max(n - 2, 0)))
    count = min(STENCIL, n)
    if slider.ring:
        period, positions = nodes[-1] - nodes[0], range(low - 1, low - 1 + count)
        revolutions = [i // (n - 1) for i in positions]
        indices = [i % (n - 1) for i in positions]
        where = [
            float(nodes[i] + period * revolution) for i, revolution in zip(indices, revolutions, strict=True)
        ]
    else:
        first = int(np.clip(low - 1, 0, n - count))
        indices = list(range(first, first + count))
        where = [float(nodes[i]) for i in indices]
    weights = [
        float(np.prod([(value - b) / (a - b) for k, b in enumerate(where) if k != j]))
        for j, a in enumerate(where)
    ]
    return indices, weights


def interpolated(slider, values, setting):
    """Return values at the nodes of a slider, (n, c), at a setting between them, (c,)."""
    indices, weights = stencil(slider, setting)
    return np.array(weights) @ values[indices]
