"""Over which part of the turn a crank can stand, exactly: the sign of a trigonometric polynomial."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mechsim.analytic.vector_method.trig_polynomial import FLAT, sampled
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array


@dataclass(frozen=True, slots=True)
class Arcs:
    """Arcs of crank angle.

    Attributes:
        full: the crank can turn fully; then `arcs` is one whole turn.
        arcs: (from, to) in [rad], from < to, from in [-pi, pi); empty if the loop closes nowhere.
    """

    full: bool
    arcs: tuple[tuple[float, float], ...]

    def start(self) -> float:
        """Return the angle to start from: 0 if the crank can stand there, else amid the longest arc.

        On an arc of more than a turn every lap is another pose: there it may be a whole turn.
        """
        if self.full or not self.arcs:
            return 0.0
        for low, high in self.arcs:
            for turn in (0.0, TURN):
                if low < turn < high:
                    return turn if high - low > TURN else 0.0
        low, high = max(self.arcs, key=lambda arc: arc[1] - arc[0])
        return (low + high) / 2.0

    def __str__(self) -> str:
        if self.full:
            return "anywhere in the turn"
        return " and ".join(f"from {low:.6g} to {high:.6g} rad" for low, high in self.arcs)


def reachable_arcs(margin: Callable[[Array], Array], degree: int) -> Arcs:
    """Return where a trigonometric polynomial of the crank angle is positive.

    Args:
        margin: the polynomial, evaluated at (n,) angles.
        degree: its highest harmonic.

    Accuracy: simple roots to a few ulp (polished by Newton's method on the polynomial itself); a
        double root, where two assemblies meet but the crank turns on, counts as no root.
    """
    rest = sampled(margin, degree)
    for double in rest.touching():
        rest = rest.without(double)
    ends = rest.roots()
    if not ends:
        full = rest.value(0.0) > 0.0
        return Arcs(full, ((-np.pi, np.pi),) if full else ())
    gaps = list(zip(ends, [*ends[1:], ends[0] + TURN], strict=True))
    return _joined(gaps, [rest.value((low + high) / 2.0) / rest.scale for low, high in gaps])


def _joined(gaps: list[tuple[float, float]], heights: list[float]) -> Arcs:
    """Return the arcs that neighbouring gaps between roots make up, from the polynomial's height in each.

    A double root comes out as two with a gap of rounding between: it takes the sign of its neighbours.
    """
    noise = [
        abs(height) <= FLAT and high - low < 1e-3 for (low, high), height in zip(gaps, heights, strict=True)
    ]
    first = noise.index(False)
    order = [*range(first, len(gaps)), *range(first)]
    arcs: list[tuple[float, float]] = []
    inside = False
    for i in order:
        low, high = gaps[i]
        if i < first:
            low, high = low + TURN, high + TURN
        was, inside = inside, inside if noise[i] else heights[i] > 0.0
        if inside:
            low = arcs.pop()[0] if was else low
            arcs.append((low, high))
    if len(arcs) > 1 and arcs[-1][1] >= arcs[0][0] + TURN:
        arcs = [(arcs[-1][0], arcs[0][1] + TURN), *arcs[1:-1]]
    if len(arcs) == 1 and arcs[0][1] >= arcs[0][0] + TURN:
        return Arcs(True, ((-np.pi, np.pi),))
    turned = [(low - TURN, high - TURN) if low >= np.pi else (low, high) for low, high in arcs]
    return Arcs(False, tuple(sorted(turned)))
