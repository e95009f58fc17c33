"""Sheets: real roots of an equation, traced over the crank angle until they meet another root.

A root t of g(crank angle, t) = 0 keeps the sign of dg/dt until it meets a root of the other sign, at a dead
centre. This sign distinguishes most roots. Sheets distinguish several roots of the same sign. They are
constructed once over the whole revolution, so that a result depends only on its crank angle and not on the
angle before it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from mechsim.kinematics.vector_method import trig_quartic
from mechsim.mechanism.motion_laws import Arcs
from mechsim.numerics.arrays import REVOLUTION, Array, unique

Coefficients = Callable[[Array], Array]

# nodes per revolution: neighbouring roots of a sign are tens of degrees apart, a root moves by one or two
NODES = 360
SHRINK = 8.0 ** -np.arange(1, 7)
# each pass finds one more fold point in an interval between nodes with several
PASSES = 6


@dataclass(frozen=True, slots=True)
class Sheet:
    """A root over a range of crank angle.

    Attributes:
        low: start of the range, in [-pi, pi) rad.
        high: end of the range; it can exceed a revolution, because a root need not be periodic in one.
        closed: whether the root is periodic with high - low.
        angles: crank angles of its nodes, increasing, (m,).
        roots: t at the nodes, continuous, (m,).
    """

    low: float
    high: float
    closed: bool
    angles: Array
    roots: Array

    @property
    def layers(self) -> int:
        """Largest number of roots of this sheet at a crank angle."""
        turns = (self.high - self.low) / REVOLUTION
        return max(1, round(turns)) if self.closed else int(np.ceil(turns))

    def unrolled(self, angles: Array, layer: int) -> Array:
        """Return crank angles shifted by whole revolutions onto the sheet, (n,); NaN outside it.

        Layer 0 has the shift by the fewest revolutions, layer 1 the next.
        """
        if self.closed:
            return self.low + np.mod(angles + layer * REVOLUTION - self.low, self.high - self.low)
        first = np.ceil((self.low - angles) / REVOLUTION)
        last = np.floor((self.high - angles) / REVOLUTION)
        clipped = np.clip(0.0, first, np.maximum(first, last))
        # layers: the nearest revolution, then its neighbours, upwards first
        above, below = last - clipped, clipped - first
        shift = (
            clipped if layer == 0 else np.where(above >= layer, clipped + layer, clipped - (layer - above))
        )
        inside = (last >= first) & (layer <= above + below)
        return np.where(inside, angles + REVOLUTION * shift, np.nan)

    def guide(self, unrolled: Array) -> Array:
        """Return the interpolated root, (n,) in [rad]; NaN off the sheet."""
        return np.where(np.isnan(unrolled), np.nan, np.interp(unrolled, self.angles, self.roots))

    def arcs(self, layer: int) -> Arcs:
        """Return the intervals of crank angle of a layer."""
        if self.closed:
            return Arcs(True, ((-np.pi, np.pi),))
        low, high = self.low, self.high - REVOLUTION * layer
        return Arcs(False, ((low, high),)) if high > low else Arcs(False, ())


def sheets(coefficients: Coefficients, domain: Arcs, sign: int) -> list[Sheet]:
    """Return the sheets of the roots with one sign of the derivative, those at crank angle zero first.

    Args:
        coefficients: crank angles (n,) -> trigonometric polynomials, (5, n), smooth.
        domain: crank angles at which the polynomial exists.
        sign: sign of the derivative by the root.
    """
    branches = [sheet for arc in domain.arcs for sheet in _over(coefficients, arc, domain.full, sign)]

    def rank(sheet: Sheet) -> tuple[bool, float, float]:
        at_zero = sheet.guide(sheet.unrolled(np.zeros(1), 0))[0]
        missing = bool(np.isnan(at_zero))
        return missing, 0.0 if missing else float(abs(np.sin(at_zero))), sheet.low

    return sorted(branches, key=rank)


def _over(coefficients: Coefficients, arc: tuple[float, float], full: bool, sign: int) -> list[Sheet]:
    """Return the sheets over an interval; those of a full revolution can continue across its ends."""
    folds, nodes = _nodes(coefficients, arc, full)
    polynomials = coefficients(nodes)
    roots = trig_quartic.real_roots(polynomials)
    kept = np.where(sign * trig_quartic.derivative(polynomials, roots) > 0.0, roots, np.nan)
    columns = [column[~np.isnan(column)] for column in kept.T]
    count = len(columns)
    follows: dict[tuple[int, int], tuple[int, int]] = {}
    for i in range(count if full else count - 1):
        k = (i + 1) % count
        follows |= {(i, a): (k, b) for a, b in _matched(columns[i], columns[k])}
    successors = set(follows.values())
    every = [(i, j) for i in range(count) for j in range(len(columns[i]))]
    waiting = dict.fromkeys(every)
    out = []
    # open sheets first, from nodes without a predecessor; the remaining chains are closed
    for begin in [node for node in every if node not in successors] + every:
        if begin not in waiting:
            continue
        chain = [begin]
        del waiting[begin]
        while (node := follows.get(chain[-1], chain[-1])) in waiting:
            chain.append(node)
            del waiting[node]
        closed = follows.get(chain[-1]) == begin
        out.append(_sheet(chain, closed, nodes, columns, [*folds, *(() if full else arc)]))
    return out


def _sheet(
    chain: list[tuple[int, int]], closed: bool, nodes: Array, columns: list[Array], ends: list[float]
) -> Sheet:
    angles = np.unwrap(nodes[np.array([i for i, _ in chain])])
    roots: Array = np.unwrap(np.array([columns[i][j] for i, j in chain])).astype(np.float64)
    if closed:
        turns = max(1, round((angles[-1] - angles[0]) / REVOLUTION))
        back = roots[-1] + np.mod(roots[0] - roots[-1] + np.pi, REVOLUTION) - np.pi
        low, high = angles[0], angles[0] + turns * REVOLUTION
        angles, roots = np.append(angles, high), np.append(roots, back)
    else:
        low = angles[0] - min((angles[0] - end) % REVOLUTION for end in ends)
        high = angles[-1] + min((end - angles[-1]) % REVOLUTION for end in ends)
    shift = REVOLUTION * np.floor((low + np.pi) / REVOLUTION)
    return Sheet(float(low - shift), float(high - shift), closed, angles - shift, roots)


def _matched(roots: Array, next_roots: Array) -> list[tuple[int, int]]:
    """Match the roots at two neighbouring nodes, at most four each, with the least total displacement."""
    if len(roots) > len(next_roots):
        return [(b, a) for a, b in _matched(next_roots, roots)]
    if len(next_roots) == 1:
        return [(0, 0)] if len(roots) else []
    gap = np.abs(np.mod(roots[:, None] - next_roots[None] + np.pi, REVOLUTION) - np.pi)
    choices = permutations(range(len(next_roots)), len(roots))
    best = min(choices, key=lambda c: sum(gap[i, j] for i, j in enumerate(c)))
    return list(enumerate(best))


def _nodes(coefficients: Coefficients, arc: tuple[float, float], full: bool) -> tuple[list[float], Array]:
    """Return the fold points, where two roots meet, and nodes with at most one between neighbours."""
    low, high = arc
    if full:
        base = np.linspace(low, high, NODES + 1)
    else:  # at the ends of the interval roots vary like a square root
        base = (low + high) / 2.0 - (high - low) / 2.0 * np.cos(np.pi * (np.arange(NODES) + 0.5) / NODES)

    def apart(angles: Array) -> Array:
        return trig_quartic.discriminant(coefficients(angles))

    def count(angles: Array) -> Array:
        return (~np.isnan(trig_quartic.real_roots(coefficients(angles)))).sum(0)

    nodes, folds = base, np.empty(0)
    for _ in range(PASSES):
        nodes = unique(np.append(nodes, _dips(apart, nodes)))
        counts = count(nodes)
        passed = np.searchsorted(folds, nodes)
        changes = np.nonzero((counts[1:] != counts[:-1]) & (passed[1:] == passed[:-1]))[0]
        if len(changes) == 0:
            break
        lower, upper, before = nodes[changes], nodes[changes + 1], counts[changes]
        for _ in range(52):
            middle = (lower + upper) / 2.0
            same = count(middle) == before
            lower, upper = np.where(same, middle, lower), np.where(same, upper, middle)
        new = (lower + upper) / 2.0
        # near a fold point roots vary like a square root: reduce the node distances by a factor of eight
        clusters = [
            (np.outer(end - new, SHRINK) + new[:, None]).ravel()
            for end in (nodes[changes], nodes[changes + 1])
        ]
        folds, nodes = unique(np.append(folds, new)), unique(np.concatenate([nodes, *clusters]))
    return folds.tolist(), nodes[:-1] if full else nodes


def _dips(function: Callable[[Array], Array], nodes: Array) -> Array:
    """Return the sign changes of a function between nodes at which its sign is constant."""
    values = function(nodes)
    magnitude, side = np.abs(values), values > 0.0
    dips = (magnitude[1:-1] < magnitude[:-2]) & (magnitude[1:-1] <= magnitude[2:])
    dips &= (side[1:-1] == side[:-2]) & (side[1:-1] == side[2:])
    minima = np.nonzero(dips)[0] + 1
    if len(minima) == 0:
        return nodes[:0]
    lower, upper, sign = nodes[minima - 1], nodes[minima + 1], np.where(side[minima], 1.0, -1.0)
    fractions = np.linspace(0.0, 1.0, 9)[:, None]
    lowest = nodes[minima]
    for _ in range(20):
        tries = lower + (upper - lower) * fractions  # (9, dips)
        heights = sign * function(tries.ravel()).reshape(tries.shape)
        best = np.clip(np.argmin(heights, 0), 1, 7)
        columns = np.arange(len(minima))
        lower, upper, lowest = tries[best - 1, columns], tries[best + 1, columns], tries[best, columns]
    return lowest[sign * function(lowest) < 0.0]
