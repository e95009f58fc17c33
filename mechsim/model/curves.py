"""Curves on links, x(s), y(s), z(s) in [m], for points and rollers that follow them.

The centre of a roller of radius r follows the offset curve c + r n with the normal n. It is regular if r is
smaller than the radius of curvature 1/k on the side of the roller: 1 - r k > 0 (do Carmo, *Differential
Geometry of Curves and Surfaces*, sec. 1.5; Norton, *Cam Design and Manufacturing Handbook*, ch. 7).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from mechsim.errors import InputError
from mechsim.model.coupling_functions import PlainFunction, TabledFunction, WrittenFunction
from mechsim.numerics.arrays import Array
from mechsim.numerics.jets import Jet

# intervals of s between which a curve is checked; those of its polygon, which is
# searched for crossings: a prime number, since symmetric curves must not cross at corners of the polygon
INTERVALS, SEGMENTS = 720, 509
# times that the search for the largest curvature is refined to two intervals
REFINEMENTS = 3
# largest change of direction in [rad] between two values of s that is not halved, and number of halvings;
# what remains is a corner
SHARP, HALVINGS = 0.1, 40
# speed below which a curve stands still, as a fraction of its largest; largest differences of the positions
# and of the tangents at the ends of a closed one, relative to these
STILL, CLOSED, SMOOTHLY = 1e-9, 1e-9, 1e-6


@dataclass(frozen=True)
class Curve:
    """A curve, or the path of a roller's centre along it.

    Attributes:
        name: of the curve, for messages.
        axes: x and y, or x, y and z, as functions of s in [m].
        interval: of s; a period of a closed curve.
        closed: whether it repeats after this interval.
        bounded: whether it ends with the interval.
        offset: distance of the roller's centre to the left of increasing s, in [m].
    """

    name: str
    axes: tuple[PlainFunction, ...]
    interval: tuple[float, float]
    closed: bool = False
    bounded: bool = False
    offset: float = 0.0

    def __post_init__(self) -> None:
        _require_closed(self)
        _require_smooth(self)
        if len(self.axes) == 2:
            _require_curvature(self)
            if self.closed or self.bounded:
                _require_no_crossing(self)

    def jets(self, s: Array) -> list[Jet]:
        """Return x, y and, of a spatial curve, z with their first two derivatives by s."""
        pairs = [axis.with_derivative(s) for axis in self.axes]
        if self.offset == 0.0:
            return [value for value, _ in pairs]
        (x, dx), (y, dy) = pairs
        scale: Any = self.offset / np.sqrt(dx * dx + dy * dy)
        return [x - scale * dy, y + scale * dx]

    def curvature(self, s: Array) -> Array:
        """Return the curvature of the curve without its offset in [1/m], positive to the left."""
        (_, dx), (_, dy) = (axis.with_derivative(s) for axis in self.axes)
        return (dx.value * dy.rate - dy.value * dx.rate) / np.hypot(dx.value, dy.value) ** 3

    def outside(self) -> float:
        """Return -1 if the outside of a closed planar curve is to the right of increasing s, else 1."""
        x, y = (axis(np.linspace(*self.interval, SEGMENTS + 1))[0] for axis in self.axes)
        return -float(np.sign((x[:-1] * np.diff(y) - y[:-1] * np.diff(x)).sum()))


@dataclass(frozen=True)
class CurveAxis:
    """A coordinate of a curve as the function of a coupling.

    Attributes:
        curve: the curve.
        axis: 0, 1 or 2 for x, y or z.
    """

    curve: Curve
    axis: int

    @property
    def text(self) -> str:
        """Its name, for messages."""
        return f"{'xyz'[self.axis]} of curve {self.curve.name}"

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of s in which an assembly is searched."""
        return self.curve.interval

    def __call__(self, s: Array) -> tuple[Array, Array, Array]:
        """Return the value and its first two derivatives at s; NaN beyond the ends of the curve."""
        jet, (low, high) = self.curve.jets(np.asarray(s))[self.axis], self.curve.interval
        if not self.curve.bounded:
            return jet.value, jet.rate, jet.second
        inside = (low <= np.real(s)) & (np.real(s) <= high)
        value, rate, second = (np.where(inside, entry, np.nan) for entry in (jet.value, jet.rate, jet.second))
        return value, rate, second


CouplingFunction = WrittenFunction | TabledFunction | CurveAxis


def _require_closed(curve: Curve) -> None:
    ends = np.array([axis(np.array(curve.interval))[:2] for axis in curve.axes])
    if not np.isfinite(ends).all():
        raise InputError(f"curve {curve.name!r} is not finite at the ends of s, {_ends(curve)}; change range")
    size = np.abs(ends[:, 0]).max()
    if curve.closed and not np.abs(np.diff(ends[:, 0])).max() <= CLOSED * size:
        gap = float(np.linalg.norm(np.diff(ends[:, 0])))
        raise InputError(
            f"curve {curve.name!r} is not closed: its ends at s = {_ends(curve)} are {gap:.4g} m apart; "
            "change range, or leave out closed"
        )
    if curve.closed and not np.abs(np.diff(ends[:, 1])).max() <= SMOOTHLY * np.abs(ends[:, 1]).max():
        raise InputError(
            f"curve {curve.name!r} is not smooth: its tangent differs at its ends, s = {_ends(curve)}; "
            "change range"
        )


def _require_smooth(curve: Curve) -> None:
    """Raise InputError where the tangent jumps: halve the intervals in which it changes much."""
    low = np.linspace(*curve.interval, INTERVALS + 1)
    step = (low[1] - low[0]) * np.ones(len(low))
    if not curve.closed:
        low, step = low[:-1], step[:-1]
    rate = np.linalg.norm(_tangents(curve, low), axis=0)
    fastest = float(rate.max())
    if not np.isfinite(rate).all():
        raise InputError(
            f"curve {curve.name!r} is not finite at s = {low[~np.isfinite(rate)][0]:.6g}; change range"
        )
    for _ in range(HALVINGS):
        first, last = _tangents(curve, low), _tangents(curve, low + step)
        speeds = np.linalg.norm(first, axis=0), np.linalg.norm(last, axis=0)
        still = np.minimum(*speeds) <= STILL * fastest
        turn = (first * last).sum(0) / np.where(still, 1.0, speeds[0] * speeds[1])
        sharp = still | (turn < np.cos(SHARP))
        # a curve that stands still is sharp everywhere: the first intervals decide
        low, step = low[sharp][:SEGMENTS], 0.5 * step[sharp][:SEGMENTS]
        if not len(low):
            return
        low, step = np.concatenate([low, low + step]), np.tile(step, 2)
    raise InputError(
        f"curve {curve.name!r} is not smooth: its tangent jumps or is zero at s = {low[0]:.6g}; round the "
        "corner, or leave it out by range"
    )


def _require_curvature(curve: Curve) -> None:
    """Raise InputError for a roller that is not smaller than the radius of curvature: it is undercut."""
    if curve.offset == 0.0:
        return
    low, high = curve.interval
    for _ in range(REFINEMENTS):
        s = np.linspace(low, high, INTERVALS + 1)
        product = curve.offset * curve.curvature(s)
        worst = int(np.argmax(product))
        at, radius = float(s[worst]), abs(curve.offset / float(product[worst]))
        low, high = s[max(worst - 1, 0)], s[min(worst + 1, INTERVALS)]
        if not product[worst] < 1.0:
            raise InputError(
                f"curve {curve.name!r} has the radius of curvature {radius:.6g} m at s = {at:.6g} on the "
                f"side of a roller of {abs(curve.offset):.6g} m: the roller cuts under; give a smaller roller, or "
                "the other side"
            )


def _require_no_crossing(curve: Curve) -> None:
    """Raise InputError if two segments of the curve's polygon cross, of neighbours all but the next ones."""
    s = np.linspace(*curve.interval, SEGMENTS + 1)
    points = np.array([jet.value + 0.0 * s for jet in curve.jets(s)])
    start, end = points[:, :-1], points[:, 1:]

    def side(point: Array) -> Array:
        """On which side of each segment (rows) each point (columns) lies."""
        along, across = (end - start)[..., None], point[:, None] - start[..., None]
        return np.sign(along[0] * across[1] - along[1] * across[0])

    parted = side(start) * side(end) < 0.0
    crossed = np.triu(parted & parted.T, 2)
    if crossed.any():
        first, second = (0.5 * (s[index[0]] + s[index[0] + 1]) for index in np.nonzero(crossed))
        what = "the path of the roller's centre on curve" if curve.offset else "curve"
        raise InputError(
            f"{what} {curve.name!r} crosses itself near s = {first:.3g} and s = {second:.3g}; leave one out "
            "by range"
        )


def _tangents(curve: Curve, s: Array) -> Array:
    return np.array([axis(s)[1] + 0.0 * s for axis in curve.axes])


def _ends(curve: Curve) -> str:
    return " and ".join(f"{end:.6g}" for end in curve.interval)
