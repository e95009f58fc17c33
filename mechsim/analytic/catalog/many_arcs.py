"""Reachable crank ranges of many designs of a closed form, from the roots of their margins."""

import numpy as np
from numpy.typing import NDArray

from mechsim.analytic.catalog.many_designs import Turning
from mechsim.numerics.angles import TURN
from mechsim.numerics.arrays import Array

# distance of a root from the unit circle up to which it is real, and up to which that is not certain
REAL, NEARLY = 1e-6, 1e-2
# real roots nearer to each other in [rad], and leading coefficients smaller than this part of the largest,
# leave a design to be solved by itself
APART, LEAST = 1e-2, 1e-8
NEWTON = 3

Complex = NDArray[np.complex128]


def swing_arcs(found: Turning) -> tuple[Array, Array]:
    """Return lower and upper ends of the arc over which each crank swings, (n,) in [rad].

    That is the arc with crank angle zero, otherwise the longest. NaN where there is none, or none that is
    certain.
    """
    count = found.margins.shape[1]
    order = np.arange(count) - count // 2
    harmonics = np.fft.fftshift(found.margins, axes=1)
    low, high = np.full(len(harmonics), np.nan), np.full(len(harmonics), np.nan)
    lead = np.abs(harmonics[:, -1]) > LEAST * np.abs(harmonics).max(1)
    index = np.flatnonzero(lead & np.isfinite(harmonics).all(1) & ~found.full)
    if not len(index):
        return low, high
    roots = _roots(harmonics[index])
    off = np.abs(np.abs(roots) - 1.0)
    certain = ((off < REAL) | (off > NEARLY)).all(1)
    number = (off < REAL).sum(1)
    for real in range(2, count, 2):
        rows = np.flatnonzero(certain & (number == real))
        if len(rows):
            at = np.angle(roots[rows][off[rows] < REAL]).reshape(len(rows), real)
            ends = _chosen(
                np.sort(_polished(at, harmonics[index[rows]], order)), harmonics[index[rows]], order
            )
            low[index[rows]], high[index[rows]] = ends
    return low, high


def _roots(harmonics: Complex) -> Complex:
    """Return the complex roots of polynomials with coefficients (n, k + 1) by rising power, (n, k)."""
    n, degree = len(harmonics), harmonics.shape[1] - 1
    companion = np.zeros((n, degree, degree), dtype=np.complex128)
    companion[:, 1:, :-1] = np.eye(degree - 1)
    companion[:, :, -1] = -harmonics[:, :-1] / harmonics[:, -1:]
    return np.linalg.eigvals(companion).astype(np.complex128)


def _values(at: Array, harmonics: Complex, order: Array, derivative: int = 0) -> Array:
    """Return polynomials (n, k) or a derivative at angles (n, m)."""
    turned = np.exp(1j * at[..., None] * order) * (1j * order) ** derivative
    return (turned * harmonics[:, None]).sum(-1).real


def _polished(at: Array, harmonics: Complex, order: Array) -> Array:
    for _ in range(NEWTON):
        slope = _values(at, harmonics, order, 1)
        at = at - _values(at, harmonics, order) / np.where(slope == 0.0, np.inf, slope)
    return at


def _chosen(ends: Array, harmonics: Complex, order: Array) -> tuple[Array, Array]:
    """Return the arc with crank angle zero, otherwise the longest, between roots (n, m) that rise."""
    after = np.concatenate([ends[:, 1:], ends[:, :1] + TURN], 1)
    width = after - ends
    open_ = _values(0.5 * (ends + after), harmonics, order) > 0.0
    holds_zero = np.mod(-ends, TURN) < width
    best = np.argmax(np.where(open_, width + 2.0 * TURN * holds_zero, -1.0), 1)
    row = np.arange(len(ends))
    low, wide, zero = ends[row, best], width[row, best], holds_zero[row, best]
    low = np.where(zero & (low > 0.0), low - TURN, low)
    good = open_[row, best] & (width.min(1) > APART)
    return np.where(good, low, np.nan), np.where(good, low + wide, np.nan)
