"""Over which part of the turn a crank can stand, exactly: the sign of a trigonometric polynomial."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
TURN = 2.0 * np.pi


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
        """Return the angle to start from: 0 if the crank can stand there, else amid the longest arc."""
        if self.full or not self.arcs:
            return 0.0
        if any(low < turn < high for low, high in self.arcs for turn in (0.0, TURN)):
            return 0.0
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
        double root, where two assemblies touch but the crank turns on, counts as no root.
    """
    count = 2 * degree + 1
    samples = margin(TURN * np.arange(count) / count)
    harmonics = np.fft.fft(samples) / count
    scale = np.abs(harmonics).max()
    # with z = exp(i angle): z^degree times the polynomial is an ordinary one of degree 2 degree
    coefficients = np.concatenate([harmonics[-degree:], harmonics[: degree + 1]])
    roots = np.roots(coefficients[::-1])
    near = np.abs(np.abs(roots) - 1.0) < 1e-5
    order = np.arange(-degree, degree + 1)

    def value(angle: float, derivative: int = 0) -> float:
        return float(((1j * order) ** derivative * coefficients * np.exp(1j * order * angle)).sum().real)

    ends = []
    for guess in np.angle(roots[near]):
        angle = float(guess)
        for _ in range(8):
            slope = value(angle, 1)
            if abs(slope) <= 1e-9 * scale:
                break
            angle -= float(np.clip(value(angle) / slope, -1e-2, 1e-2))
        ends.append((angle + np.pi) % TURN - np.pi)
    ends = sorted(ends)
    if not ends:
        full = value(0.0) > 0.0
        return Arcs(full, ((-np.pi, np.pi),) if full else ())
    arcs: list[tuple[float, float]] = []
    for low, high in zip(ends, [*ends[1:], ends[0] + TURN], strict=True):
        if high - low > 1e-7 and value((low + high) / 2.0) > 0.0:
            if arcs and low - arcs[-1][1] <= 1e-7:
                arcs[-1] = (arcs[-1][0], high)
            else:
                arcs.append((low, high))
    if len(arcs) == 1 and arcs[0][1] - arcs[0][0] > TURN - 1e-7:
        return Arcs(True, ((-np.pi, np.pi),))
    return Arcs(False, tuple(arcs))
