"""Which curves a point or a roller can follow: closed as stated, smooth, without crossings and undercut.

The path of a roller's centre, c + r n, is regular if the radius r is smaller than the radius of curvature 1/k
on the side of the roller: 1 - r k > 0 (do Carmo, *Differential Geometry of Curves and Surfaces*, sec. 1.5;
Norton, *Cam Design and Manufacturing Handbook*, ch. 7).
"""

import numpy as np

from mechsim.errors import InputError
from mechsim.mechanism.curves import GuideCurve
from mechsim.numerics.arrays import Array
from mechsim.numerics.peaks import peak

# intervals of s between which a curve is checked; those of its polygon, which is searched for crossings: a
# prime number, since symmetric curves must not cross at corners of the polygon
INTERVALS, SEGMENTS = 720, 509
# largest change of direction in [rad] between two values of s that is not halved, and number of halvings;
# what remains is a corner
SHARP, HALVINGS = 0.1, 40
# speed below which a curve stands still, as a fraction of its largest; largest differences of the positions
# and of the tangents at the ends of a closed one, relative to these
STILL, CLOSED, SMOOTHLY = 1e-9, 1e-9, 1e-6


def require_followable(curve: GuideCurve) -> None:
    """Raise InputError for a curve that no point, or no roller, can follow."""
    _require_closed(curve)
    _require_smooth(curve)
    if len(curve.axes) == 2:
        _require_curvature(curve)
        if curve.closed or curve.bounded:
            _require_no_crossing(curve)


def _require_closed(curve: GuideCurve) -> None:
    ends = np.array([axis(np.array(curve.interval))[:2] for axis in curve.axes])
    if not np.isfinite(ends).all():
        raise InputError(f"curve {curve.name!r} is not finite at the ends of s, {_ends(curve)}; change range")
    # the position of the ends alone can be zero
    scale = np.abs(ends[:, 0]).max() + np.ptp(curve.interval) * np.abs(ends[:, 1]).max()
    if curve.closed and not np.abs(np.diff(ends[:, 0])).max() <= CLOSED * scale:
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


def _require_smooth(curve: GuideCurve) -> None:
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
        cosine = (first * last).sum(0) / np.where(still, 1.0, speeds[0] * speeds[1])
        sharp = still | (cosine < np.cos(SHARP))
        # a curve that stands still is sharp everywhere: the first intervals decide
        low, step = low[sharp][:SEGMENTS], 0.5 * step[sharp][:SEGMENTS]
        if not len(low):
            return
        low, step = np.concatenate([low, low + step]), np.tile(step, 2)
    raise InputError(
        f"curve {curve.name!r} is not smooth: its tangent jumps or is zero at s = {low[0]:.6g}; round the "
        "corner, or leave it out by range"
    )


def _require_curvature(curve: GuideCurve) -> None:
    """Raise InputError for a roller that is not smaller than the radius of curvature: it is undercut."""
    if curve.offset == 0.0:
        return
    at_s, product = peak(
        lambda s: curve.offset * curve.curvature(s), np.linspace(*curve.interval, INTERVALS + 1)
    )
    if not product < 1.0:
        raise InputError(
            f"curve {curve.name!r} has the radius of curvature {abs(curve.offset / product):.6g} m at s = "
            f"{at_s:.6g} on the side of a roller of {abs(curve.offset):.6g} m: the roller cuts under; give "
            "a smaller one, or the other side"
        )


def _require_no_crossing(curve: GuideCurve) -> None:
    """Raise InputError if two segments of the curve's polygon cross, of neighbours all but the next ones."""
    s = np.linspace(*curve.interval, SEGMENTS + 1)
    if curve.closed:
        # a crossing at the ends would be a corner
        s += 0.37 * (s[1] - s[0])
    points = np.array([jet.value + 0.0 * s for jet in curve.jets(s)])
    start, end = points[:, :-1], points[:, 1:]

    def side(point: Array) -> Array:
        """On which side of each segment (rows) each point (columns) lies."""
        along, across = (end - start)[..., None], point[:, None] - start[..., None]
        return np.sign(along[0] * across[1] - along[1] * across[0])

    parted = side(start) * side(end) < 0.0
    crossed = np.triu(parted & parted.T, 2)
    # of a closed curve the last segment ends where the first begins
    crossed[0, -1] &= not curve.closed
    if crossed.any():
        first, second = (0.5 * (s[index[0]] + s[index[0] + 1]) for index in np.nonzero(crossed))
        what = "the path of the roller's centre on curve" if curve.offset else "curve"
        raise InputError(
            f"{what} {curve.name!r} crosses itself near s = {first:.3g} and s = {second:.3g}; leave one out "
            "by range"
        )


def _tangents(curve: GuideCurve, s: Array) -> Array:
    return np.array([axis(s)[1] + 0.0 * s for axis in curve.axes])


def _ends(curve: GuideCurve) -> str:
    return " and ".join(f"{end:.6g}" for end in curve.interval)
